#include "core/formats/medical/sample_series.h"

#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::MetaHeader;
using ::isoscope::testing::NiftiHeaderBytes;
using ::isoscope::testing::NrrdHeader;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr math::Index3 kDims{4, 3, 2};
constexpr int kSamples = 24;

// Sample i of volume v is 100 v + i.
std::string Volumes(int count) {
  std::vector<std::int16_t> values;
  for (int v = 0; v < count; ++v) {
    for (int i = 0; i < kSamples; ++i) {
      values.push_back(static_cast<std::int16_t>(100 * v + i));
    }
  }
  return BytesOf(values);
}

// The same, as tuples.
std::string Tuples(int count) {
  std::vector<std::int16_t> values;
  for (int i = 0; i < kSamples; ++i) {
    for (int v = 0; v < count; ++v) {
      values.push_back(static_cast<std::int16_t>(100 * v + i));
    }
  }
  return BytesOf(values);
}

class SampleSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    testing::WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  // Volume v of the file, by its component and step, in rows of any order.
  static void ExpectVolume(VolumeSeries& series, int component, int step, int v) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series.Open(0, component, step));
    EXPECT_EQ(source->info().geometry.sample_dims, kDims);
    for (const std::int64_t planes : {1, 2}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, planes));
      EXPECT_EQ(bytes, Volumes(v + 1).substr(static_cast<std::size_t>(v) * kSamples * 2));
    }
  }
  testing::TempDir dir_;
};

TEST_F(SampleSeriesTest, NiftiStepsAndComponents) {
  std::string header = NiftiHeaderBytes({.dims = kDims, .dim_count = 5, .dim4 = 4});
  const std::int16_t components = 3;
  const float interval = 0.5F;
  std::memcpy(header.data() + 50, &components, 2);
  std::memcpy(header.data() + 92, &interval, 4);
  for (const std::string& path :
       {Write("run.nii", header + Volumes(12)), Write("run.nii.gz", Gzip(header + Volumes(12)))}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_EQ(series->info().fields[0].name, "run");
    EXPECT_THAT(series->info().fields[0].components, ElementsAre("x", "y", "z"));
    EXPECT_THAT(series->info().times, ElementsAre(0, 0.5, 1, 1.5));
    EXPECT_EQ(series->info().time_unit, "s");
    EXPECT_EQ(series->info().length_unit, "mm");
    for (int step = 0; step < 4; ++step) {
      for (int component = 0; component < 3; ++component) {
        ExpectVolume(*series, component, step, component * 4 + step);
      }
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto plain,
      OpenVolumeFile(Write("one.nii", NiftiHeaderBytes({.dims = kDims}) + Volumes(1))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("run.nii")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 3));
  EXPECT_EQ(volume->info().geometry, plain->info().geometry);
  EXPECT_TRUE(volume->info().patient_frame.has_value());
  const auto cut = OpenVolumeSeries(Write("cut.nii", header + Volumes(11)));
  ISOSCOPE_ASSERT_OK(cut.status());
  EXPECT_THAT((*cut)->Open(0, 0, 0),
              StatusIs(kInvalid, AllOf(HasSubstr("12 volumes"), HasSubstr("the file has"))));
}

std::string Nrrd4(const std::string& sizes, const std::string& kinds, const std::string& directions,
                  const std::string& more = "") {
  return absl::StrCat("NRRD0005\ntype: short\ndimension: 4\nendian: little\nencoding: raw\n",
                      "space: left-posterior-superior\nsizes: ", sizes, "\nkinds: ", kinds,
                      "\nspace directions: ", directions, "\nspace origin: (10,20,30)\n", more,
                      "\n");
}

TEST_F(SampleSeriesTest, NrrdAxesFirstAndLast) {
  constexpr char kFirst[] = "none (0,1.5,0) (-2,0,0) (0,0,3)";
  constexpr char kLast[] = "(0,1.5,0) (-2,0,0) (0,0,3) none";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto vectors,
      OpenVolumeSeries(
          Write("v.nrrd", Nrrd4("2 4 3 2", "2-vector domain domain domain", kFirst) + Tuples(2))));
  EXPECT_THAT(vectors->info().fields[0].components, ElementsAre("0", "1"));
  EXPECT_THAT(vectors->info().times, IsEmpty());
  ExpectVolume(*vectors, 1, 0, 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto list,
      OpenVolumeSeries(
          Write("l.nrrd", Nrrd4("4 3 2 3", "domain domain domain list", kLast) + Volumes(3))));
  EXPECT_THAT(list->info().fields[0].components, ElementsAre("x", "y", "z"));
  ExpectVolume(*list, 2, 0, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto steps,
      OpenVolumeSeries(Write("t.nrrd", Nrrd4("4 3 2 5", "domain domain domain time", kLast,
                                             "spacings: nan nan nan 0.5\n") +
                                           Volumes(5))));
  EXPECT_THAT(steps->info().fields[0].components, ElementsAre(""));
  EXPECT_THAT(steps->info().times, ElementsAre(0, 0.5, 1, 1.5, 2));
  ExpectVolume(*steps, 0, 4, 4);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto first,
      OpenVolumeSeries(
          Write("f.nrrd", Nrrd4("5 4 3 2", "time domain domain domain", kFirst) + Tuples(5))));
  EXPECT_EQ(first->info().step_count(), 5);
  ExpectVolume(*first, 0, 3, 3);
}

TEST_F(SampleSeriesTest, NrrdOf64BitIntegers) {
  std::vector<std::int64_t> values(kSamples, -5);
  const std::string header = NrrdHeader(kDims, "long long", "raw");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto good,
                                OpenVolumeSeries(Write("w.nrrd", header + BytesOf(values))));
  EXPECT_THAT(good->info().times, IsEmpty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, good->Open(0, 0, 0));
  EXPECT_EQ(source->info().type, volume::ScalarType::kFloat64);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1));
  EXPECT_EQ(ValuesOf<double>(bytes), std::vector<double>(kSamples, -5.0));
  values[17] = (std::int64_t{1} << 53) + 2;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto bad,
                                OpenVolumeSeries(Write("w.nrrd", header + BytesOf(values))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto large, bad->Open(0, 0, 0));
  EXPECT_THAT(ReadAll(*large, 1),
              StatusIs(kInvalid, AllOf(HasSubstr("w.nrrd"), HasSubstr("(1, 1, 1)"),
                                       HasSubstr("9007199254740994"))));
}

TEST_F(SampleSeriesTest, ChannelsOfMetaImage) {
  const std::string header =
      MetaHeader(kDims, "MET_SHORT", "LOCAL", "ElementNumberOfChannels = 4\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                OpenVolumeSeries(Write("c.mha", header + Tuples(4))));
  EXPECT_THAT(series->info().fields[0].components, ElementsAre("0", "1", "2", "3"));
  for (int component = 0; component < 4; ++component) {
    ExpectVolume(*series, component, 0, component);
  }
}

TEST_F(SampleSeriesTest, AFourthAxisOfMetaImageIsSteps) {
  std::string head = MetaHeader(kDims, "MET_SHORT", "LOCAL");
  head.replace(head.find("NDims = 3"), 9, "NDims = 4");
  head.replace(head.find("DimSize = 4 3 2"), 15, "DimSize = 4 3 2 3");
  head.replace(head.find("0 1 0 -1 0 0 0 0 1"), 18, "0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1");
  head.replace(head.find("10 20 30"), 8, "10 20 30 0");
  head.replace(head.find("1.5 2 3"), 7, "1.5 2 3 1");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                OpenVolumeSeries(Write("a.mha", head + Volumes(3))));
  EXPECT_EQ(series->info().step_count(), 3);
  EXPECT_THAT(series->info().times, ElementsAre(0, 1, 2));
  ExpectVolume(*series, 0, 2, 2);
}

TEST_F(SampleSeriesTest, OneVolumeIsASeriesOfOneStep) {
  for (const auto& [format, path] :
       {std::pair{FileFormat::kMetaImage,
                  Write("a.mha", MetaHeader(kDims, "MET_SHORT", "LOCAL") + Volumes(1))},
        std::pair{FileFormat::kNrrd,
                  Write("a.nrrd", NrrdHeader(kDims, "short", "raw") + Volumes(1))}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenSampleSeries(format, path, "name", "a"));
    EXPECT_EQ(series->info().name, "name");
    EXPECT_THAT(series->info().times, IsEmpty());
    ExpectVolume(*series, 0, 0, 0);
  }
}

TEST_F(SampleSeriesTest, NrrdThatIsNoVolumeIsNamed) {
  const auto open = [&](const std::string& lines, const std::string& type = "short") {
    return OpenVolumeSeries(
        Write("n.nrrd", absl::StrCat("NRRD0005\ntype: ", type, "\nendian: little\nencoding: raw\n",
                                     lines, "\n", Volumes(4))));
  };
  EXPECT_THAT(open("dimension: 2\nsizes: 4 3\n"),
              StatusIs(kInvalid, HasSubstr("2-dimensional, 4 x 3 samples")));
  EXPECT_THAT(open("dimension: 5\nsizes: 4 3 2 2 2\n"),
              StatusIs(kInvalid, AllOf(HasSubstr("5-dimensional"), HasSubstr("extract one"))));
  ISOSCOPE_EXPECT_OK(open("dimension: 5\nsizes: 4 3 2 1 1\n").status());
  EXPECT_THAT(open("dimension: 4\nsizes: 4 3 2\n"), StatusIs(kInvalid, HasSubstr("dimension 4")));
  EXPECT_THAT(open("dimension: 3\nsizes: 4 3 1\n"), StatusIs(kInvalid, HasSubstr("4 x 3 x 1")));
  EXPECT_THAT(open("dimension: 3\nsizes: 4 3 2\n", "block"),
              StatusIs(kInvalid, HasSubstr("\"block\"")));
}

// An axis without a direction or a distance became one of samples 1 apart.
TEST_F(SampleSeriesTest, NrrdAxesThatAreNotOfSpaceAreRefused) {
  const auto open = [&](const std::string& lines, const GridRules& rules = {}) {
    const std::string path =
        Write("n.nrrd", absl::StrCat("NRRD0005\ntype: short\nendian: little\nencoding: raw\n"
                                     "dimension: 3\nsizes: 4 3 2\n",
                                     lines, "\n", Volumes(1)));
    return OpenVolumeFile(path, "", rules).status();
  };
  const GridRules both{.has_spacing = true, .has_direction = true};
  for (const char* directions :
       {"(0.5,0,0) (0,0.25,0) none", "none (0.5,0,0) (0,0.25,0)", "(0.5,0,0) NONE (0,0.25,0)"}) {
    for (const char* space :
         {"space: LPS\n", "space dimension: 3\nkinds: domain domain domain\n"}) {
      const std::string lines =
          absl::StrCat(space, "space directions: ", directions, "\nspace origin: (1,2,3)\n");
      EXPECT_THAT(open(lines), StatusIs(kInvalid, AllOf(HasSubstr("\"none\": it is not of space"),
                                                        HasSubstr("--spacing X,Y,Z"),
                                                        HasSubstr("--direction XX"))))
          << directions;
      EXPECT_THAT(open(lines, {.has_spacing = true}), StatusIs(kInvalid));
      ISOSCOPE_EXPECT_OK(open(lines, both));
    }
  }
  const std::string time = "kinds: domain domain time\nspacings: 0.5 0.25 nan\n";
  EXPECT_THAT(open(time), StatusIs(kInvalid, AllOf(HasSubstr("along axis 2 is not known"),
                                                   HasSubstr("--spacing X,Y,Z"))));
  ISOSCOPE_EXPECT_OK(open(time, {.has_spacing = true}));
  for (const char* kinds :
       {"vector domain domain", "domain domain list", "domain RGB-color domain"}) {
    EXPECT_THAT(open(absl::StrCat("kinds: ", kinds, "\nspacings: 1 1 1\n"), both),
                StatusIs(kInvalid, HasSubstr("not of space")))
        << kinds;
  }
}

// It was read as little-endian.
TEST_F(SampleSeriesTest, NrrdOfSeveralBytesASampleHasAByteOrder) {
  const auto open = [&](const std::string& type, const std::string& lines) {
    return OpenVolumeFile(Write("e.nrrd", absl::StrCat("NRRD0005\ntype: ", type,
                                                       "\ndimension: 3\nsizes: 4 3 2\n", lines,
                                                       "\n", std::string(24 * 8, '1'))))
        .status();
  };
  for (const char* type : {"short", "float", "double", "long long"}) {
    for (const char* lines : {"encoding: raw\n", "encoding: gzip\n", "encoding: hex\n",
                              "encoding: raw\nendian: middle\n"}) {
      EXPECT_THAT(open(type, lines),
                  StatusIs(kInvalid, AllOf(HasSubstr("e.nrrd"), HasSubstr("endian"))))
          << type << lines;
    }
    ISOSCOPE_EXPECT_OK(open(type, "encoding: raw\nendian: BIG\n"));
  }
  ISOSCOPE_EXPECT_OK(open("uint8", "encoding: raw\n"));
  ISOSCOPE_EXPECT_OK(open("short", "encoding: ascii\n"));
}

TEST_F(SampleSeriesTest, NrrdOfFourAxesOfSpaceIsRefused) {
  EXPECT_THAT(OpenVolumeSeries(Write("four.nrrd", Nrrd4("4 3 2 2", "domain domain domain domain",
                                                        "(1,0,0) (0,1,0) (0,0,1) (0,0,1)"))),
              StatusIs(kInvalid, HasSubstr("four.nrrd")));
}

}  // namespace
}  // namespace isoscope::source
