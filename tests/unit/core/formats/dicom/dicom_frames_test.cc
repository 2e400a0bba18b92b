// Several series in a folder, steps, and files of many frames.

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/dicom/dicom_source.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/dicom_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/dicom/htj2k_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomItem;
using ::isoscope::testing::DicomNumber;
using ::isoscope::testing::DicomSlice;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr std::uint16_t kWidth = 4;
constexpr std::uint16_t kHeight = 3;
constexpr int kSamples = kWidth * kHeight;

// Sample i of an image is 100 image + i.
std::string Pixels(int image) {
  std::vector<std::int16_t> values;
  for (int i = 0; i < kSamples; ++i) {
    values.push_back(static_cast<std::int16_t>(100 * image + i));
  }
  return BytesOf(values);
}

class DicomFramesTest : public ::testing::Test {
 protected:
  void Write(const std::string& name, DicomSlice slice, const std::string& pixels) {
    slice.width = kWidth;
    slice.height = kHeight;
    testing::WriteFile(dir_.Sub(name), DicomBytes(slice, pixels));
  }
  // A file whose frame i is image i, at z of `places[i]`, with those elements of functional groups.
  void WriteFrames(const std::string& name, const std::vector<double>& places,
                   const std::vector<std::string>& groups, const std::string& more = "") {
    std::string pixels;
    std::string frames;
    for (std::size_t i = 0; i < places.size(); ++i) {
      pixels += Pixels(static_cast<int>(i));
      const std::string position =
          DicomElement(0x20, 0x32, "DS", absl::StrCat("10\\20\\", places[i]));
      frames += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)) + groups[i]);
    }
    Write(name,
          {.storage_class = "1.2.840.10008.5.1.4.1.1.4.1",
           .more = more + DicomElement(0x5200, 0x9230, "SQ", frames),
           .frames = static_cast<int>(places.size())},
          pixels);
  }
  testing::TempDir dir_;
};

TEST_F(DicomFramesTest, SeveralSeriesAreListedAndOneIsChosen) {
  for (int z = 0; z < 3; ++z) {
    for (const int series : {7, 3}) {
      Write(absl::StrCat(series, "-", z, ".dcm"),
            {.series = absl::StrCat("1.2.", series),
             .position = absl::StrCat("0\\0\\", z),
             .number = z,
             .description = series == 3 ? "T1 axial" : "",
             .series_number = series},
            Pixels(series));
    }
  }
  EXPECT_THAT(
      OpenVolumeFile(dir_.path()),
      StatusIs(kInvalid, AllOf(HasSubstr("2 series"), HasSubstr("--series N"),
                               HasSubstr("3 \"T1 axial\", 3 images of 4 x 3; 7, 3 images"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("7-0.dcm")));
  EXPECT_EQ(ValuesOf<std::int16_t>(ReadAll(*volume, 3).value())[1], 701);
}

TEST_F(DicomFramesTest, ImagesAtOnePlaceAreSteps) {
  for (int z = 0; z < 3; ++z) {
    for (int t = 0; t < 2; ++t) {
      Write(absl::StrCat(2 * z + 1 - t),
            {.position = absl::StrCat("10\\20\\", 30 + 1.5 * z),
             .number = 5 - t,
             .temporal_position = 1 + t},
            Pixels(3 * t + z));
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.path()));
  EXPECT_THAT(series->info().times, ElementsAre(0, 1));
  EXPECT_EQ(series->info().length_unit, "mm");
  for (int t = 0; t < 2; ++t) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, t));
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{kWidth, kHeight, 3}));
    EXPECT_EQ(volume->info().geometry.origin, (math::Vec3d{10, 20, 30}));
    EXPECT_TRUE(volume->info().patient_frame.has_value());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 2));
    EXPECT_EQ(bytes, Pixels(3 * t) + Pixels(3 * t + 1) + Pixels(3 * t + 2));
  }
  EXPECT_THAT(OpenVolumeFile(dir_.path()), StatusIs(kInvalid, HasSubstr("steps: 2, from 0 to 1")));
}

TEST_F(DicomFramesTest, FramesAreSlicesByTheirPositions) {
  WriteFrames("a.dcm", {34, 30, 32}, {"", "", ""});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("a.dcm")));
  EXPECT_EQ(volume->info().type, volume::ScalarType::kInt16);
  const math::Mat4d to_world = volume->info().geometry.world_from_index();
  EXPECT_EQ(math::TransformPoint(to_world, {0, 0, 0}), (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(math::TransformPoint(to_world, {3, 2, 2}), (math::Vec3d{11.5, 24, 34}));
  for (const std::int64_t planes : {1, 3}) {
    EXPECT_EQ(ReadAll(*volume, planes).value(), Pixels(1) + Pixels(2) + Pixels(0));
  }
}

TEST_F(DicomFramesTest, FramesHaveTheirOwnSlopesAndSteps) {
  const auto group = [](int temporal, const char* slope) {
    const std::string content =
        DicomElement(0x20, 0x9128, "UL", DicomNumber(static_cast<std::uint32_t>(temporal)));
    const std::string values =
        DicomElement(0x28, 0x1052, "DS", "-5") + DicomElement(0x28, 0x1053, "DS", slope);
    return DicomElement(0x20, 0x9111, "SQ", DicomItem(content)) +
           DicomElement(0x28, 0x9145, "SQ", DicomItem(values));
  };
  WriteFrames("a.dcm", {30, 30, 32, 32},
              {group(2, "2"), group(1, "1"), group(2, "0.5"), group(1, "1")});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("a.dcm")));
  EXPECT_THAT(series->info().times, ElementsAre(0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 1));
  ASSERT_EQ(volume->info().type, volume::ScalarType::kFloat32);
  const auto values = ValuesOf<float>(ReadAll(*volume, 2).value());
  for (int i = 0; i < kSamples; ++i) {
    EXPECT_EQ(values[static_cast<std::size_t>(i)], static_cast<float>(2 * i - 5));
    EXPECT_EQ(values[static_cast<std::size_t>(kSamples + i)],
              static_cast<float>(0.5 * (200 + i) - 5));
  }
}

TEST_F(DicomFramesTest, DoseGridsAreScaledAndLieAtTheirOffsets) {
  Write("dose.dcm",
        {.is_signed = false,
         .storage_class = "1.2.840.10008.5.1.4.1.1.481.2",
         .more =
             DicomElement(0x3004, 0x0c, "DS", "0\\3\\6") + DicomElement(0x3004, 0x0e, "DS", "0.25"),
         .frames = 3},
        Pixels(0) + Pixels(1) + Pixels(2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("dose.dcm")));
  ASSERT_EQ(volume->info().type, volume::ScalarType::kFloat32);
  const auto values = ValuesOf<float>(ReadAll(*volume, 2).value());
  for (int image = 0; image < 3; ++image) {
    for (int i = 0; i < kSamples; ++i) {
      EXPECT_EQ(values[static_cast<std::size_t>(kSamples * image + i)],
                0.25F * static_cast<float>(100 * image + i));
    }
  }
  EXPECT_EQ(math::TransformPoint(volume->info().geometry.world_from_index(), {3, 2, 2}),
            (math::Vec3d{11.5, 24, 36}));
}

TEST_F(DicomFramesTest, HighThroughputJpeg2000IsDecoded) {
  const std::string codestream = testing::Htj2kBytes();
  const std::vector<std::uint16_t> samples = testing::Htj2kSamples();
  for (const char* last : {"1", "2", "3"}) {
    const std::string syntax = absl::StrCat("1.2.840.10008.1.2.4.20", last);
    for (const int z : {0, 1}) {
      testing::WriteFile(dir_.Sub(absl::StrCat("h", z)),
                         DicomBytes({.width = 8,
                                     .height = 8,
                                     .position = absl::StrCat("0\\0\\", z),
                                     .is_signed = false,
                                     .intercept = z == 0 ? "0" : "-1024",
                                     .slope = "1",
                                     .transfer_syntax = syntax,
                                     .fragments = {codestream}},
                                    ""));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("h0")));
    ASSERT_EQ(volume->info().type, volume::ScalarType::kInt16) << "12 bits from -1024 on";
    const auto values = ValuesOf<std::int16_t>(ReadAll(*volume, 2).value());
    for (std::size_t i = 0; i < 64; ++i) {
      ASSERT_EQ(values[i], samples[i]);
      ASSERT_EQ(values[64 + i], samples[i] - 1024);
    }
  }
}

// A frame may be cut into several fragments.
TEST_F(DicomFramesTest, HighThroughputFramesBeginWithTheirCodestreams) {
  const std::string codestream = testing::Htj2kBytes();
  std::string groups;
  for (const int z : {0, 1}) {
    const std::string position = DicomElement(0x20, 0x32, "DS", absl::StrCat("0\\0\\", z));
    groups += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)));
  }
  const DicomSlice slice{
      .width = 8,
      .height = 8,
      .is_signed = false,
      .more = DicomElement(0x5200, 0x9230, "SQ", groups),
      .frames = 2,
      .transfer_syntax = "1.2.840.10008.1.2.4.201",
      .fragments = {codestream.substr(0, 100), codestream.substr(100), codestream}};
  testing::WriteFile(dir_.Sub("h"), DicomBytes(slice, ""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("h")));
  const std::string samples = BytesOf(testing::Htj2kSamples());
  EXPECT_EQ(ReadAll(*volume, 2).value(), samples + samples);
}

// A mirrored volume was the consequence of each of these.
TEST_F(DicomFramesTest, NuclearMedicineIsStackedAgainstTheNormalByANegativeDistance) {
  const auto write = [this](const char* distance) {
    const std::string detector = DicomItem(DicomElement(0x20, 0x32, "DS", "1\\2\\3") +
                                           DicomElement(0x20, 0x37, "DS", "0\\1\\0\\0\\0\\1"));
    Write("n.dcm",
          {.position = "",
           .orientation = "",
           .storage_class = "1.2.840.10008.5.1.4.1.1.20",
           .more = DicomElement(0x18, 0x88, "DS", distance) +
                   DicomElement(0x54, 0x22, "SQ", detector) +
                   DicomElement(0x54, 0x80, "US",
                                DicomNumber(std::uint16_t{1}) + DicomNumber(std::uint16_t{2})),
           .frames = 2},
          Pixels(0) + Pixels(1));
    return OpenVolumeFile(dir_.Sub("n.dcm"));
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto along, write("4"));
  EXPECT_EQ(math::TransformPoint(along->info().geometry.world_from_index(), {0, 0, 1}),
            (math::Vec3d{5, 2, 3}));
  EXPECT_EQ(ReadAll(*along, 2).value(), Pixels(0) + Pixels(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto against, write("-4"));
  EXPECT_EQ(against->info().geometry.origin, (math::Vec3d{-3, 2, 3}));
  EXPECT_EQ(ReadAll(*against, 2).value(), Pixels(1) + Pixels(0));
}

TEST_F(DicomFramesTest, FramesAtOnePlaceAreInTheOrderOfTheirDimensions) {
  // In no order in the file; the last index is that of steps.
  const auto index = [](std::uint32_t place, std::uint32_t step) {
    return DicomElement(
        0x20, 0x9111, "SQ",
        DicomItem(DicomElement(0x20, 0x9157, "UL", DicomNumber(place) + DicomNumber(step))));
  };
  const auto dimension = [](std::uint16_t group, std::uint16_t element) {
    return DicomItem(DicomElement(0x20, 0x9165, "AT", DicomNumber(group) + DicomNumber(element)));
  };
  const std::string dimensions =
      DicomElement(0x20, 0x9222, "SQ", dimension(0x20, 0x9057) + dimension(0x18, 0x9087));
  WriteFrames("a.dcm", {32, 30, 30, 32}, {index(2, 1), index(1, 2), index(1, 1), index(2, 2)},
              dimensions);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("a.dcm")));
  ASSERT_EQ(series->info().step_count(), 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, series->Open(0, 0, 0));
  EXPECT_EQ(ReadAll(*first, 2).value(), Pixels(2) + Pixels(0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, series->Open(0, 0, 1));
  EXPECT_EQ(ReadAll(*second, 2).value(), Pixels(1) + Pixels(3));
}

TEST_F(DicomFramesTest, UltrasoundVolumesLieByTheProbe) {
  std::string groups;
  for (const double z : {-2.0, 1.0}) {
    const std::string position =
        DicomElement(0x20, 0x9301, "FD", DicomNumber(5.0) + DicomNumber(6.0) + DicomNumber(z));
    std::string directions;
    for (const double d : {1.0, 0.0, 0.0, 0.0, 1.0, 0.0}) {
      directions += DicomNumber(d);
    }
    groups += DicomItem(
        DicomElement(0x20, 0x930e, "SQ", DicomItem(position)) +
        DicomElement(0x20, 0x930f, "SQ", DicomItem(DicomElement(0x20, 0x9302, "FD", directions))));
  }
  Write("u.dcm",
        {.position = "",
         .orientation = "",
         .storage_class = "1.2.840.10008.5.1.4.1.1.6.2",
         .more = DicomElement(0x5200, 0x9230, "SQ", groups),
         .frames = 2},
        Pixels(0) + Pixels(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("u.dcm")));
  EXPECT_EQ(volume->info().geometry.origin, (math::Vec3d{5, 6, -2}));
  EXPECT_EQ(volume->info().geometry.spacing.z, 3);
  EXPECT_FALSE(volume->info().patient_frame.has_value());
}

TEST_F(DicomFramesTest, FilesOfFramesAreStepsInTheOrderOfTheirNumbers) {
  std::string groups;
  for (const int z : {30, 32}) {
    const std::string position = DicomElement(0x20, 0x32, "DS", absl::StrCat("10\\20\\", z));
    groups += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)));
  }
  for (const int file : {1, 0}) {
    Write(absl::StrCat("f", 1 - file),
          {.number = file + 1, .more = DicomElement(0x5200, 0x9230, "SQ", groups), .frames = 2},
          Pixels(2 * file) + Pixels(2 * file + 1));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.path()));
  ASSERT_EQ(series->info().step_count(), 2);
  for (int step = 0; step < 2; ++step) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, step));
    EXPECT_EQ(ReadAll(*volume, 2).value(), Pixels(2 * step) + Pixels(2 * step + 1));
  }
}

// GDCM ends its process on these.
TEST_F(DicomFramesTest, WholeSlideImagesAreRefusedByName) {
  Write("w.dcm", {.storage_class = "1.2.840.10008.5.1.4.1.1.77.1.6", .frames = 3},
        Pixels(0) + Pixels(1) + Pixels(2));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("w.dcm")),
              StatusIs(kInvalid, AllOf(HasSubstr("whole-slide"), HasSubstr("3 frames"),
                                       Not(HasSubstr("SIGABRT")))));
}

TEST_F(DicomFramesTest, ParametricMapsOfFloatsAreRefusedByName) {
  for (const char element : {'\x08', '\x09'}) {
    std::string bytes = DicomBytes({.width = kWidth, .height = kHeight, .frames = 2},
                                   Pixels(0) + Pixels(1) + Pixels(2) + Pixels(3));
    bytes[bytes.rfind(std::string("\xe0\x7f\x10\x00", 4)) + 2] = element;
    testing::WriteFile(dir_.Sub("p.dcm"), bytes);
    EXPECT_THAT(OpenVolumeFile(dir_.Sub("p.dcm")),
                StatusIs(kInvalid, AllOf(HasSubstr("parametric map"), Not(HasSubstr("cut")))));
  }
}

TEST_F(DicomFramesTest, UnevenAndUnplacedFramesAreRefused) {
  WriteFrames("a.dcm", {30, 32, 37}, {"", "", ""});
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("a.dcm")),
              StatusIs(kInvalid, AllOf(HasSubstr("5 behind"), HasSubstr("frame 1, where 2 is"),
                                       HasSubstr("at one distance"))));
  Write("b.dcm", {.series = "1.2.8", .frames = 3}, Pixels(0) + Pixels(1) + Pixels(2));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("b.dcm")),
              StatusIs(kInvalid, HasSubstr("no spacing between slices (0018,0088)")));
  Write("c.dcm", {.series = "1.2.9", .frames = 3}, Pixels(0) + Pixels(1));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("c.dcm")), StatusIs(kInvalid, HasSubstr("cut")));
}

}  // namespace
}  // namespace isoscope::source
