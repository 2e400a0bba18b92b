// Reconstructions of ParaVision: samples beside those that ITK reads, corners, what is a step and
// what a field, and what is refused.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkBruker2dseqImageIO.h"

#include "core/formats/medical/layout_formats.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BrukerScan;
using ::isoscope::testing::BrukerText;
using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Planes of 4 x 3; sample i of plane p is 100 p + i.
std::string Planes(int count) {
  std::vector<std::int16_t> values;
  for (int p = 0; p < count; ++p) {
    for (int i = 0; i < 12; ++i) {
      values.push_back(static_cast<std::int16_t>(100 * p + i));
    }
  }
  return BytesOf(values);
}

class BrukerLayoutTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::unique_ptr<VolumeSeries>> Open(const std::string& text,
                                                     const std::string& samples) {
    WriteFile(dir_.Sub("visu_pars"), text);
    WriteFile(path_, samples);
    return OpenVolumeSeries(path_);
  }
  // All samples that ITK reads.
  [[nodiscard]] std::vector<float> ReadByItk() const {
    const auto io = itk::Bruker2dseqImageIO::New();
    io->SetFileName(path_);
    io->ReadImageInformation();
    EXPECT_EQ(io->GetComponentType(), itk::IOComponentEnum::FLOAT);
    const unsigned axes = io->GetNumberOfDimensions();
    itk::ImageIORegion region(axes);
    for (unsigned axis = 0; axis < axes; ++axis) {
      region.SetIndex(axis, 0);
      region.SetSize(axis, io->GetDimensions(axis));
    }
    io->SetIORegion(region);
    std::vector<float> samples(static_cast<std::size_t>(io->GetImageSizeInPixels()));
    io->Read(samples.data());
    return samples;
  }
  // The same by our own reader: fields with all their steps.
  static std::vector<float> ReadByUs(VolumeSeries* series) {
    std::vector<float> all;
    for (int field = 0; field < static_cast<int>(series->info().fields.size()); ++field) {
      for (int step = 0; step < series->info().step_count(); ++step) {
        const auto volume = series->Open(field, 0, step);
        EXPECT_THAT(volume, testing::IsOk());
        const auto bytes = ReadAll(**volume, 1);
        EXPECT_THAT(bytes, testing::IsOk());
        const std::vector<float> values = ValuesOf<float>(*bytes);
        all.insert(all.end(), values.begin(), values.end());
      }
    }
    return all;
  }
  absl::Status Error(const std::string& text, const std::string& samples = Planes(6)) {
    auto series = Open(text, samples);
    return series.ok() ? (*series)->Open(0, 0, 0).status() : series.status();
  }

  const testing::TempDir dir_;
  const std::string path_ = dir_.Sub("2dseq");
};

TEST_F(BrukerLayoutTest, SamplesAreThoseThatItkReads) {
  struct Case {
    std::string name;
    BrukerScan scan;
    int steps = 1;
  };
  const std::vector<Case> cases{
      {"slices", {}},
      {"reversed", {.more = "##$VisuCoreDiskSliceOrder=disk_reverse_slice_order\n"}},
      {"echoes, then slices", {.groups = {{2, "FG_ECHO"}, {3, "FG_SLICE"}}}, 2},
      {"slices, then cycles", {.groups = {{3, "FG_SLICE"}, {2, "FG_CYCLE"}}}, 2},
      {"between", {.groups = {{2, "FG_ECHO"}, {3, "FG_SLICE"}, {2, "FG_CYCLE"}}}, 4},
      {"volumes", {.is_volume = true, .groups = {{2, "FG_MOVIE"}}}, 2},
      {"one volume", {.is_volume = true}},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    BrukerScan scan = c.scan;
    // Of each frame, since ITK 5.2 reads behind the end of a shorter list.
    const int frames = (scan.is_volume ? 1 : 3) * c.steps;
    scan.slopes.clear();
    scan.offsets.clear();
    for (int frame = 0; frame < frames; ++frame) {
      scan.slopes.push_back(0.5 + frame);
      scan.offsets.push_back(frame % 2 - 3);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(BrukerText(scan), Planes(3 * c.steps)));
    EXPECT_EQ(series->info().step_count(), c.steps);
    EXPECT_EQ(ReadByUs(series.get()), ReadByItk());
  }
}

TEST_F(BrukerLayoutTest, FramesWithoutGroupsAreSlices) {
  std::string text = BrukerText({});
  const std::size_t at = text.find("##$VisuFGOrderDesc");
  text = text.substr(0, at) + "##END=\n";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(text, Planes(3)));
  EXPECT_EQ(series->info().step_count(), 1);
  EXPECT_EQ(ReadByUs(series.get())[35], 2 * 211);
}

TEST_F(BrukerLayoutTest, OneSlopeIsThatOfAllFrames) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                Open(BrukerText({.slopes = {0.25}, .offsets = {7}}), Planes(3)));
  const std::vector<float> values = ReadByUs(series.get());
  EXPECT_EQ(values[1], 7.25F);
  EXPECT_EQ(values[35], 7 + 0.25F * 211);
}

TEST_F(BrukerLayoutTest, TypesAndByteOrders) {
  BrukerScan scan;
  scan.slopes = {1};
  scan.offsets = {0};
  scan.byte_order = "bigEndian";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, Open(BrukerText(scan), Swapped(Planes(3), 2)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().type, volume::ScalarType::kInt16);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::string bytes, ReadAll(*volume, 1));
  EXPECT_EQ(bytes, Planes(3));
  scan.byte_order = "littleEndian";
  struct Case {
    const char* name;
    volume::ScalarType type;
  };
  for (const Case& c : {Case{"_8BIT_UNSGN_INT", volume::ScalarType::kUint8},
                        Case{"_8BIT_SGN_INT", volume::ScalarType::kInt8},
                        Case{"_32BIT_SGN_INT", volume::ScalarType::kInt32},
                        Case{"_32BIT_FLOAT", volume::ScalarType::kFloat32}}) {
    scan.type = c.name;
    const std::string samples(36 * volume::SizeOf(c.type), '\1');
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, Open(BrukerText(scan), samples));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(volume, series->Open(0, 0, 0));
    EXPECT_EQ(volume->info().type, c.type);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(bytes, ReadAll(*volume, 1));
    EXPECT_EQ(bytes, samples);
  }
}

// Sizes are 2, 1.5 and 3 mm. The corner is at (10, 20, 30).
TEST_F(BrukerLayoutTest, PositionsAreOfCornersAndOfSlicesInTheirMiddle) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, Open(BrukerText({}), Planes(3)));
  EXPECT_EQ(series->info().length_unit, "mm");
  EXPECT_EQ(series->info().fields[0].name, "2dseq");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto volume, series->Open(0, 0, 0));
  const auto at = [&](const math::Vec3d& index) {
    return math::TransformPoint(volume->info().geometry.world_from_index(), index);
  };
  EXPECT_EQ(at({0, 0, 0}), (math::Vec3d{11, 20.75, 30}));
  EXPECT_EQ(at({3, 2, 2}), (math::Vec3d{17, 23.75, 36}));
  // Index x along world y, y against world z, z against world x.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      series,
      Open(BrukerText({.axes = "0 1 0 0 0 -1 -1 0 0", .slice_step = {-3, 0, 0}}), Planes(3)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(volume, series->Open(0, 0, 0));
  EXPECT_EQ(at({0, 0, 0}), (math::Vec3d{10, 21, 29.25}));
  EXPECT_EQ(at({3, 2, 2}), (math::Vec3d{4, 27, 26.25}));
  // A volume's third axis has a corner, too.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, Open(BrukerText({.is_volume = true}), Planes(3)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(volume, series->Open(0, 0, 0));
  EXPECT_EQ(at({0, 0, 0}), (math::Vec3d{11, 20.75, 31.5}));
  EXPECT_THAT(Error(BrukerText({.slices = 1}), Planes(1)),
              StatusIs(kInvalid, HasSubstr("4 x 3 x 1 samples")));
}

TEST_F(BrukerLayoutTest, ImagesOfSeveralKindsAreFields) {
  const BrukerScan scan{.groups = {{3, "FG_SLICE"}, {2, "FG_ISA"}, {2, "FG_ECHO"}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(BrukerText(scan), Planes(12)));
  ASSERT_EQ(series->info().fields.size(), 2u);
  EXPECT_EQ(series->info().fields[0].name, "isa 1");
  EXPECT_EQ(series->info().fields[1].name, "isa 2");
  EXPECT_EQ(series->info().step_count(), 2);
  for (const auto& [field, step, frame] : {std::array{1, 0, 3}, {0, 1, 6}, {1, 1, 9}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(field, 0, step));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<float>(bytes)[0], 2 * 100 * frame);  // slope 2
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenVolumeSeries(path_ + ":isa 2"));
  EXPECT_EQ(part->info().fields.size(), 1u);
}

TEST_F(BrukerLayoutTest, EitherFileOpensAndBothAreItsFiles) {
  WriteFile(dir_.Sub("visu_pars"), BrukerText({}));
  WriteFile(path_, Planes(3));
  ISOSCOPE_ASSERT_OK(OpenVolumeFile(dir_.Sub("visu_pars")).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path_));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("visu_pars"), path_));
  EXPECT_EQ(LayoutHeaderPath("my2dseq"), "my2dseq");
}

TEST_F(BrukerLayoutTest, RepeatedNumbersAndCommentsAreRead) {
  const std::string text = absl::StrReplaceAll(
      BrukerText({}), {{"1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1",
                        "@2*(1 0 0 0 1 0 0 0 1) 1\n$$ a comment\n @3*(0) 1 @3*(0) 1"}});
  ASSERT_THAT(text, HasSubstr("@2*("));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(text, Planes(3)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().geometry.origin, (math::Vec3d{11, 20.75, 30}));
}

TEST_F(BrukerLayoutTest, WhatIsNoPlainVolumeIsRefusedWithItsNumbers) {
  const std::string good = BrukerText({.slopes = {2, 2, 2}});
  const auto with = [&](const std::string& from, const std::string& to) {
    EXPECT_THAT(good, HasSubstr(from));
    return absl::StrReplaceAll(good, {{from, to}});
  };
  EXPECT_THAT(Error(BrukerText({.axes = "0 1 0 0 0 -1 -1 0 0"})),
              StatusIs(kInvalid,
                       AllOf(HasSubstr("go on by (0, 0, 3)"), HasSubstr("normal is (-1, 0, 0)"))));
  EXPECT_THAT(Error(with("10 20 36", "10 20 37")),
              StatusIs(kInvalid, HasSubstr("slices 1 and 2 are (0, 0, 4) apart")));
  EXPECT_THAT(Error(with("1 0 0 0 1 0 0 0 1 1 0 0 0", "1 0 0 0 1 0 0 0 1 0 1 0 0")),
              StatusIs(kInvalid, HasSubstr("several orientations")));
  EXPECT_THAT(
      Error(with("1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1", "2 0 0 0 1 0 0 0 1")),
      StatusIs(kInvalid, HasSubstr("length 2")));
  EXPECT_THAT(Error(with("VisuCoreDim=2", "VisuCoreDim=1")),
              StatusIs(kInvalid, HasSubstr("1 axes")));
  EXPECT_THAT(Error(with("spatial spatial", "spectroscopic spatial")),
              StatusIs(kInvalid, HasSubstr("(spectroscopic spatial)")));
  EXPECT_THAT(Error(with("FrameCount=3", "FrameCount=4")),
              StatusIs(kInvalid, HasSubstr("has 3 frames; VisuCoreFrameCount is 4")));
  EXPECT_THAT(Error(with("(3, <FG_SLICE>", "(3 <FG_SLICE>")),
              StatusIs(kInvalid, HasSubstr("VisuFGOrderDesc has \"(3 <FG_SLICE>")));
  std::string groups;
  for (int i = 0; i < 100'000; ++i) {
    groups += "(1, <FG_ECHO>) ";
  }
  EXPECT_THAT(Error(with("(3, <FG_SLICE>", groups + "(3, <FG_SLICE>")),
              StatusIs(kInvalid, HasSubstr("more than 16 groups")));
  EXPECT_THAT(Error(with("_16BIT_SGN_INT", "_64BIT_FLOAT")),
              StatusIs(kInvalid, HasSubstr("_64BIT_FLOAT")));
  EXPECT_THAT(Error(with("littleEndian", "middle")), StatusIs(kInvalid, HasSubstr("middle")));
  EXPECT_THAT(Error(with("\n4 3\n", "\n4 3.5\n")), StatusIs(kInvalid, HasSubstr("3.5")));
  EXPECT_THAT(Error(with("\n4 3\n", "\n4 x\n")), StatusIs(kInvalid, HasSubstr("\"x\"")));
  EXPECT_THAT(Error(with("10 20 36", "10 20")),
              StatusIs(kInvalid, HasSubstr("VisuCorePosition has 8 numbers; expected 3 or 9")));
  EXPECT_THAT(Error(with("##END=\n", "")), StatusIs(kInvalid, HasSubstr("no ##END")));
  EXPECT_THAT(Error(with("\n2 2 2\n", "\n@99999999999*(1)\n")),
              StatusIs(kInvalid, HasSubstr("more than")));
  EXPECT_THAT(Error(with("\n2 2 2\n", "\n@9223372036854775808*(1 1)\n")),  // 2 to the 63
              StatusIs(kInvalid, HasSubstr("more than")));
  EXPECT_THAT(Error(with("\n2 2 2\n", "\n@2*1\n")), StatusIs(kInvalid, HasSubstr("@COUNT")));
  EXPECT_THAT(Error(good, Planes(2)).message(), HasSubstr("2dseq"));
  std::filesystem::create_directory(dir_.Sub("lone"));
  WriteFile(dir_.Sub("lone/visu_pars"), good);
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("lone/2dseq")).status().message(),
              HasSubstr("lone/2dseq: no such file"));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("lone/visu_pars")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("its data file")));
}

TEST_F(BrukerLayoutTest, VolumesThatMoveAreRefused) {
  BrukerScan scan{.groups = {{3, "FG_SLICE"}, {2, "FG_CYCLE"}}};
  const std::string text = BrukerText(scan);
  const std::string three = "( 3, 3 )\n10 20 30 10 20 33 10 20 36";
  ASSERT_THAT(text, HasSubstr(three));
  const auto with = [&](const std::string& second) {
    return absl::StrReplaceAll(
        text, {{three, "( 6, 3 )\n10 20 30 10 20 33 10 20 36 10 20 30 10 20 33 " + second}});
  };
  ISOSCOPE_EXPECT_OK(Error(with("10 20 36")));
  EXPECT_THAT(Error(with("10 21 36")),
              StatusIs(kInvalid, HasSubstr("frame 5 lies at (10, 21, 36)")));
}

TEST_F(BrukerLayoutTest, AHeaderThatIsCutAnywhereEndsInASentence) {
  const std::string text = BrukerText({.groups = {{2, "FG_ECHO"}, {3, "FG_SLICE"}}});
  for (std::size_t size = 0; size + 6 < text.size(); ++size) {
    EXPECT_FALSE(Error(text.substr(0, size)).ok()) << size;
  }
}

}  // namespace
}  // namespace isoscope::source
