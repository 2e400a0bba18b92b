// Several series in a folder, steps, and files of many frames.

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/dicom_source.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/source/vti_bytes.h"

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
                   const std::vector<std::string>& groups) {
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
           .more = DicomElement(0x5200, 0x9230, "SQ", frames),
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
  EXPECT_THAT(series->times(), ElementsAre(0, 1));
  EXPECT_EQ(series->length_unit(), "mm");
  for (int t = 0; t < 2; ++t) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, t));
    EXPECT_EQ(volume->geometry().sample_dims, (math::Index3{kWidth, kHeight, 3}));
    EXPECT_EQ(volume->geometry().origin, (math::Vec3d{10, 20, 30}));
    EXPECT_TRUE(volume->patient_frame().has_value());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 2));
    EXPECT_EQ(bytes, Pixels(3 * t) + Pixels(3 * t + 1) + Pixels(3 * t + 2));
  }
  EXPECT_THAT(OpenVolumeFile(dir_.path()), StatusIs(kInvalid, HasSubstr("steps: 2, from 0 to 1")));
}

TEST_F(DicomFramesTest, FramesAreSlicesByTheirPositions) {
  WriteFrames("a.dcm", {34, 30, 32}, {"", "", ""});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("a.dcm")));
  EXPECT_EQ(volume->scalar_type(), volume::ScalarType::kInt16);
  const math::Mat4d to_world = volume->geometry().world_from_index();
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
  EXPECT_THAT(series->times(), ElementsAre(0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 1));
  ASSERT_EQ(volume->scalar_type(), volume::ScalarType::kFloat32);
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
  ASSERT_EQ(volume->scalar_type(), volume::ScalarType::kFloat32);
  const auto values = ValuesOf<float>(ReadAll(*volume, 2).value());
  for (int image = 0; image < 3; ++image) {
    for (int i = 0; i < kSamples; ++i) {
      EXPECT_EQ(values[static_cast<std::size_t>(kSamples * image + i)],
                0.25F * static_cast<float>(100 * image + i));
    }
  }
  EXPECT_EQ(math::TransformPoint(volume->geometry().world_from_index(), {3, 2, 2}),
            (math::Vec3d{11.5, 24, 36}));
}

// As a file says it of its pixels; the pixels themselves do not matter.
TEST_F(DicomFramesTest, HighThroughputJpeg2000IsNamed) {
  for (const char* last : {"1", "2", "3"}) {
    std::string bytes = DicomBytes({.width = kWidth, .height = kHeight}, Pixels(0));
    const std::string raw = "1.2.840.10008.1.2.1";
    const std::string syntax = absl::StrCat("1.2.840.10008.1.2.4.20", last);
    const std::string raw_element = DicomElement(2, 0x10, "UI", raw);
    const std::string element = DicomElement(2, 0x10, "UI", syntax);
    bytes.replace(bytes.find(raw_element), raw_element.size(), element);
    // The length of the group grows with it.
    const std::size_t length = bytes.find(DicomElement(2, 0, "UL", "").substr(0, 6)) + 8;
    const auto growth = static_cast<int>(element.size()) - static_cast<int>(raw_element.size());
    bytes[length] = static_cast<char>(bytes[length] + growth);
    testing::WriteFile(dir_.Sub("h.dcm"), bytes);
    EXPECT_THAT(OpenVolumeSeries(dir_.Sub("h.dcm")),
                StatusIs(kInvalid, AllOf(HasSubstr("High-Throughput"), HasSubstr(syntax),
                                         HasSubstr("pydicom"))))
        << last;
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
              StatusIs(kInvalid, AllOf(HasSubstr("2 behind"), HasSubstr("3.5"),
                                       HasSubstr("at one distance"))));
  Write("b.dcm", {.series = "1.2.8", .frames = 3}, Pixels(0) + Pixels(1) + Pixels(2));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("b.dcm")),
              StatusIs(kInvalid, HasSubstr("frame 0 of 3 has no position")));
  Write("c.dcm", {.series = "1.2.9", .frames = 3}, Pixels(0) + Pixels(1));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("c.dcm")), StatusIs(kInvalid, HasSubstr("cut")));
}

}  // namespace
}  // namespace isoscope::source
