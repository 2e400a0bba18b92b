#include "core/formats/dicom/dicom_segmentation.h"

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/dicom/dicom_module.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/dicom/segmentation_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NamedSegment;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::SegmentationBytes;
using ::isoscope::testing::SegmentationFile;
using ::isoscope::testing::SegmentFrame;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class DicomSegmentationTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::unique_ptr<VolumeSeries>> Open(const SegmentationFile& file) {
    testing::WriteFile(dir_.Sub("s.dcm"), SegmentationBytes(file));
    return OpenVolumeSeries(dir_.Sub("s.dcm"));
  }
  template <typename T>
  std::vector<T> Samples(VolumeSeries* series, int field = 0) {
    const auto volume = series->Open(field, 0, 0);
    ISOSCOPE_EXPECT_OK(volume);
    return volume.ok() ? ValuesOf<T>(ReadAll(**volume, 2).value_or("")) : std::vector<T>();
  }
  testing::TempDir dir_;
};

// 5 x 3 pixels, 15 bits: the second frame begins within a byte.
const std::vector<int> kLeft{1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0};
const std::vector<int> kRight{0, 0, 0, 1, 1, 0, 0, 1, 1, 1, 0, 0, 0, 0, 1};
const std::vector<int> kAll{1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};

TEST_F(DicomSegmentationTest, SegmentsAreNumbersOnTheGridOfTheirPlanes) {
  // Places 30, 32.5 and 37.5: that of 35 is left out.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open({.frames = {{"10\\20\\37.5", 2, kLeft},
                                                                    {"10\\20\\30", 9, kRight},
                                                                    {"10\\20\\30", 2, kLeft},
                                                                    {"10\\20\\32.5", 9, kLeft}}}));
  ASSERT_EQ(series->info().fields.size(), 1U);
  EXPECT_EQ(series->info().fields[0].name, "s");
  EXPECT_EQ(series->info().length_unit, "mm");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{5, 3, 4}));
  EXPECT_EQ(volume->info().type, ScalarType::kUint8);
  EXPECT_EQ(volume->info().memory_bytes, kDicomModuleBytes + 2 * 5 * 3) << "and two slices";
  EXPECT_TRUE(volume->info().patient_frame.has_value());
  const math::Mat4d to_world = volume->info().geometry.world_from_index();
  EXPECT_EQ(math::TransformPoint(to_world, {0, 0, 0}), (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(math::TransformPoint(to_world, {4, 2, 3}), (math::Vec3d{12, 24, 37.5}));
  std::vector<std::uint8_t> expected;
  for (std::size_t i = 0; i < 15; ++i) {
    expected.push_back(static_cast<std::uint8_t>(2 * kLeft[i] + 9 * kRight[i]));
  }
  for (std::size_t i = 0; i < 15; ++i) {
    expected.push_back(static_cast<std::uint8_t>(9 * kLeft[i]));
  }
  expected.resize(45);
  for (std::size_t i = 0; i < 15; ++i) {
    expected.push_back(static_cast<std::uint8_t>(2 * kLeft[i]));
  }
  EXPECT_THAT(Samples<std::uint8_t>(series.get()), ElementsAreArray(expected));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), testing::IsOk());
}

TEST_F(DicomSegmentationTest, NumbersAbove255Have16Bits) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                Open({.frames = {{"0\\0\\1", 300, kLeft}, {"0\\0\\2", 7, kLeft}}}));
  const auto samples = Samples<std::uint16_t>(series.get());
  ASSERT_EQ(samples.size(), 30U);
  EXPECT_EQ(samples[0], 300);
  EXPECT_EQ(samples[2], 0);
  EXPECT_EQ(samples[15], 7);
}

TEST_F(DicomSegmentationTest, SegmentsThatOverlapAreLayers) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open({.frames = {{"0\\0\\1", 1, kLeft},
                                                                    {"0\\0\\1", 2, kAll},
                                                                    {"0\\0\\1", 3, kRight},
                                                                    {"0\\0\\2", 2, kLeft}}}));
  ASSERT_EQ(series->info().fields.size(), 2U);
  EXPECT_EQ(series->info().fields[0].name, "layer 1");
  EXPECT_EQ(series->info().fields[1].name, "layer 2");
  const auto first = Samples<std::uint8_t>(series.get(), 0);
  const auto second = Samples<std::uint8_t>(series.get(), 1);
  for (std::size_t i = 0; i < 15; ++i) {
    EXPECT_EQ(first[i], kLeft[i] + 3 * kRight[i]);
    EXPECT_EQ(second[i], 2);
    EXPECT_EQ(first[15 + i], 0);
    EXPECT_EQ(second[15 + i], 2 * kLeft[i]);
  }
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("s.dcm")), StatusIs(kInvalid, HasSubstr("layer 2")));
}

TEST_F(DicomSegmentationTest, SharesAreAFieldForEachSegment) {
  const std::vector<int> shares{0, 255, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  const std::vector<int> other(15, 77);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      Open({.kind = "FRACTIONAL",
            .bits = 8,
            .frames = {{"0\\0\\2", 1, shares}, {"0\\0\\1", 4, other}, {"0\\0\\2", 4, other}},
            .segments = {{1, "liver"}, {4, "liver"}}}));
  ASSERT_EQ(series->info().fields.size(), 2U);
  EXPECT_EQ(series->info().fields[0].name, "liver");
  EXPECT_EQ(series->info().fields[1].name, "liver segment 4");
  const auto first = Samples<std::uint8_t>(series.get(), 0);
  EXPECT_EQ(first[0], 0);
  EXPECT_EQ(first[16], 255);
  EXPECT_EQ(first[29], 15);
  EXPECT_EQ(Samples<std::uint8_t>(series.get(), 1), std::vector<std::uint8_t>(30, 77));
}

TEST_F(DicomSegmentationTest, LabelMapsAreReadAsTheyAreAndPadded) {
  const std::vector<int> numbers{0, 1, 2, 3, 300, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14};
  const SegmentationFile file{.kind = "LABELMAP",
                              .bits = 16,
                              .frames = {{"0\\0\\1", 0, numbers}, {"0\\0\\3", 0, numbers}},
                              .distance = "1",
                              .padding = 258};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(file));
  const auto samples = Samples<std::uint16_t>(series.get());
  ASSERT_EQ(samples.size(), 45U);
  for (std::size_t i = 0; i < 15; ++i) {
    EXPECT_EQ(samples[i], numbers[i]);
    EXPECT_EQ(samples[15 + i], 258);
    EXPECT_EQ(samples[30 + i], numbers[i]);
  }
}

TEST_F(DicomSegmentationTest, FramesWithoutPlaceOrSegmentAreRefused) {
  EXPECT_THAT(Open({.frames = {{"0\\0\\1", 1, kLeft}, {"", 1, kLeft}}}),
              StatusIs(kInvalid, AllOf(HasSubstr("frame 1 of 2"), HasSubstr("no position"),
                                       HasSubstr("slides"))));
  EXPECT_THAT(Open({.frames = {{"0\\0\\1", 0, kLeft}, {"0\\0\\2", 1, kLeft}}}),
              StatusIs(kInvalid, HasSubstr("frame 0 of 2 of the segmentation has no number of a")));
  EXPECT_THAT(
      Open({.frames = {{"0\\0\\1", 6, kLeft}, {"0\\0\\2", 1, kLeft}, {"0\\0\\1", 6, kRight}}}),
      StatusIs(kInvalid, HasSubstr("frame 2 of segment 6 lies where another")));
  EXPECT_THAT(Open({.frames = {{"0\\0\\1", 1, kLeft}, {"0\\0\\1", 2, kLeft}}}),
              StatusIs(kInvalid, HasSubstr("one slice")));
}

TEST_F(DicomSegmentationTest, NoFrameIsNoVolume) {
  for (const char* kind : {"BINARY", "FRACTIONAL", "LABELMAP"}) {
    const std::uint16_t bits = kind == std::string("BINARY") ? 1 : 8;
    EXPECT_THAT(Open({.kind = kind, .bits = bits}), StatusIs(kInvalid, HasSubstr("s.dcm"))) << kind;
  }
}

TEST_F(DicomSegmentationTest, OtherPixelsAreRefusedByTheirBits) {
  const std::vector<SegmentFrame> frames{{"0\\0\\1", 1, kLeft}, {"0\\0\\2", 1, kLeft}};
  EXPECT_THAT(Open({.bits = 8, .frames = frames}),
              StatusIs(kInvalid, AllOf(HasSubstr("8 bits"), HasSubstr("BINARY of 1 bit"))));
  EXPECT_THAT(Open({.kind = "OTHER", .frames = frames}), StatusIs(kInvalid, HasSubstr("unknown")));
  std::string cut = SegmentationBytes({.frames = frames});
  cut.resize(cut.size() - 2);
  testing::WriteFile(dir_.Sub("s.dcm"), cut);
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("s.dcm")), StatusIs(kInvalid, HasSubstr("cut")));
}

TEST_F(DicomSegmentationTest, SeveralInASeriesAreVolumesOfTheirOwn) {
  const auto write = [this](int number, const std::vector<int>& pixels) {
    testing::WriteFile(
        dir_.Sub(absl::StrCat(number, ".dcm")),
        SegmentationBytes({.frames = {{"0\\0\\1", number, pixels}, {"0\\0\\2", number, pixels}},
                           .number = number}));
  };
  write(1, kLeft);
  write(2, kAll);
  EXPECT_THAT(OpenVolumeSeries(dir_.path()),
              StatusIs(kInvalid, AllOf(HasSubstr("2 segmentations"), HasSubstr("1.dcm"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("2.dcm")));
  EXPECT_EQ(Samples<std::uint8_t>(series.get()), std::vector<std::uint8_t>(30, 2));
}

}  // namespace
}  // namespace isoscope::source
