// Asks the handler in this process, with files that do not end it.

#include "core/formats/dicom/dicom_child.h"

#include <cstdint>
#include <cstring>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/math/vec.h"
#include "core/volume/scalar_type.h"
#include "tests/support/dicom_file.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/dicom/segmentation_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomItem;
using ::isoscope::testing::Noise;
using ::isoscope::testing::WriteFile;
using ::testing::ElementsAre;
using volume::ScalarType;

constexpr std::size_t kSliceBytes = 12 * 9 * 2;

class DicomChildTest : public ::testing::Test {
 protected:
  DicomAnswer Ask(DicomQuestion question, std::uint64_t frame_bytes = 0, std::uint64_t frame = 0) {
    DicomRequest request{};
    path_.copy(request.path.data(), path_.size());
    request.question = question;
    request.frame_bytes = frame_bytes;
    request.frame = frame;
    DicomAnswer answer{};
    DecodeDicomInChild(&request, &answer, shared_.data());
    return answer;
  }
  DicomFrameRecord Frame(std::size_t index) const {
    DicomFrameRecord record;
    std::memcpy(&record, shared_.data() + index * sizeof(record), sizeof(record));
    return record;
  }

  testing::TempDir dir_;
  const std::string path_ = dir_.Sub("a.dcm");
  const std::string pixels_ = Noise({12, 9, 2}, ScalarType::kInt16);
  std::string shared_ = std::string(kDicomListBytes, '?');
};

TEST_F(DicomChildTest, ImageIsAListOfOneFrame) {
  WriteFile(path_, DicomBytes({.intercept = "-5", .slope = "0.5"}, pixels_.substr(0, kSliceBytes)));
  const DicomAnswer answer = Ask(DicomQuestion::kFrames);
  EXPECT_EQ(answer.outcome, DicomOutcome::kHeader);
  EXPECT_EQ(answer.components, 1U);
  EXPECT_THAT(answer.dims, ElementsAre(12, 9, 1));
  EXPECT_EQ(answer.bits_allocated, 16U);
  EXPECT_EQ(answer.bits_stored, 16U);
  EXPECT_EQ(answer.high_bit, 15U);
  EXPECT_EQ(answer.is_signed, 1U);
  EXPECT_EQ(answer.photometric, DicomPhotometric::kMonochrome);
  EXPECT_EQ(answer.has_lut, 0U);
  EXPECT_EQ(answer.group_items, 0U);
  EXPECT_EQ(answer.dimensions[0], 0U);
  EXPECT_EQ(std::string(answer.series.data(), 6), std::string("1.2.3\0", 6));
  const DicomFrameRecord frame = Frame(0);
  EXPECT_TRUE(frame.position.is_given());
  EXPECT_THAT(frame.position.values, ElementsAre(10, 20, 30));
  EXPECT_THAT(frame.orientation.values, ElementsAre(1, 0, 0, 0, 1, 0));
  EXPECT_THAT(frame.pixel_spacing.values, ElementsAre(2, 0.5));
  EXPECT_TRUE(frame.slice_spacing.is_missing());
  EXPECT_EQ(frame.slope.value(), 0.5);
  EXPECT_EQ(frame.intercept.value(), -5);
}

TEST_F(DicomChildTest, FramesAreListedAndDecodedOneByOne) {
  std::string frames;
  for (const int z : {34, 30}) {
    const std::string position = DicomElement(0x20, 0x32, "DS", absl::StrCat("10\\20\\", z));
    const std::string values =
        DicomElement(0x28, 0x1052, "DS", "-5") + DicomElement(0x28, 0x1053, "DS", "0.5");
    frames += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)) +
                        (z == 30 ? DicomElement(0x28, 0x9145, "SQ", DicomItem(values)) : ""));
  }
  testing::DicomSlice slice{.storage_class = "1.2.840.10008.5.1.4.1.1.4.1",
                            .more = DicomElement(0x5200, 0x9230, "SQ", frames),
                            .frames = 2,
                            .transfer_syntax = testing::kDicomRle};
  WriteFile(path_, DicomBytes(slice, pixels_));
  const DicomAnswer answer = Ask(DicomQuestion::kFrames);
  EXPECT_EQ(answer.outcome, DicomOutcome::kHeader);
  EXPECT_THAT(answer.dims, ElementsAre(12, 9, 2));
  EXPECT_EQ(answer.group_items, 2U);
  EXPECT_THAT(Frame(0).position.values, ElementsAre(10, 20, 34));
  EXPECT_THAT(Frame(1).position.values, ElementsAre(10, 20, 30));
  for (const std::size_t i : {0U, 1U}) {
    EXPECT_THAT(Frame(i).orientation.values, ElementsAre(1, 0, 0, 0, 1, 0));
    EXPECT_THAT(Frame(i).pixel_spacing.values, ElementsAre(2, 0.5));
    EXPECT_EQ(Frame(i).echo_time.is_set, 0U);
  }
  EXPECT_TRUE(Frame(0).slope.is_missing());
  EXPECT_EQ(Frame(1).slope.value(), 0.5);
  EXPECT_EQ(Frame(1).intercept.value(), -5);
  for (const std::uint64_t i : {std::uint64_t{1}, std::uint64_t{0}}) {
    const DicomAnswer decoded = Ask(DicomQuestion::kFrame, kSliceBytes, i);
    EXPECT_EQ(decoded.outcome, DicomOutcome::kPixels);
    EXPECT_EQ(decoded.bits_stored, 16U);
    EXPECT_EQ(decoded.is_signed, 1U);
    EXPECT_TRUE(shared_.substr(0, kSliceBytes) == pixels_.substr(i * kSliceBytes, kSliceBytes));
  }
  EXPECT_EQ(Ask(DicomQuestion::kFrame, kSliceBytes - 2, 0).outcome, DicomOutcome::kNotDecoded);
}

TEST_F(DicomChildTest, OneCompressedImageIsDecoded) {
  WriteFile(path_,
            DicomBytes({.transfer_syntax = testing::kDicomRle}, pixels_.substr(0, kSliceBytes)));
  EXPECT_EQ(Ask(DicomQuestion::kFrames).outcome, DicomOutcome::kHeader);
  shared_.assign(shared_.size(), '?');
  EXPECT_EQ(Ask(DicomQuestion::kFrame, kSliceBytes).outcome, DicomOutcome::kPixels);
  EXPECT_TRUE(shared_.substr(0, kSliceBytes) == pixels_.substr(0, kSliceBytes));
  EXPECT_EQ(shared_[kSliceBytes], '?');
  EXPECT_EQ(Ask(DicomQuestion::kFrame, kSliceBytes - 2).outcome, DicomOutcome::kNotDecoded);
  EXPECT_EQ(Ask(DicomQuestion::kFrame, kSliceBytes, 1).outcome, DicomOutcome::kNotDecoded);
}

TEST_F(DicomChildTest, TooFewPixelsAreNotDecoded) {
  WriteFile(path_, DicomBytes({}, pixels_.substr(0, 100)));
  EXPECT_EQ(Ask(DicomQuestion::kFrame, kSliceBytes).outcome, DicomOutcome::kNotDecoded);
}

TEST_F(DicomChildTest, SegmentationsAreListedWithoutTheirPixels) {
  WriteFile(path_, testing::SegmentationBytes(
                       {.frames = {{"10\\20\\34", 3}, {"10\\20\\30", 300}},
                        .segments = {{3, "liver", {{0, 65535, 0x8080}}}, {300, "two"}},
                        .distance = "4",
                        .padding = 9}));
  const DicomAnswer answer = Ask(DicomQuestion::kFrames);
  EXPECT_EQ(answer.outcome, DicomOutcome::kHeader);
  EXPECT_THAT(answer.dims, ElementsAre(5, 3, 2));
  EXPECT_EQ(answer.components, 1U);
  EXPECT_EQ(answer.bits_allocated, 1U);
  EXPECT_EQ(answer.segment_kind, DicomSegmentKind::kBinary);
  EXPECT_EQ(answer.padding.value, 9);
  EXPECT_EQ(std::string(answer.series.data(), 5), "1.2.3");
  EXPECT_THAT(Frame(0).position.values, ElementsAre(10, 20, 34));
  EXPECT_EQ(Frame(1).slice_spacing.value(), 4);
  EXPECT_EQ(Frame(0).segment, 3U);
  EXPECT_EQ(Frame(1).segment, 300U);
  const DicomAnswer segments = Ask(DicomQuestion::kSegments);
  EXPECT_EQ(segments.outcome, DicomOutcome::kHeader);
  EXPECT_EQ(segments.segment_kind, DicomSegmentKind::kBinary);
  ASSERT_EQ(segments.dims[0], 2U);
  DicomSegmentRecord segment;
  std::memcpy(&segment, shared_.data(), sizeof(segment));
  EXPECT_EQ(segment.number, 3U);
  EXPECT_STREQ(segment.label.data(), "liver");
  EXPECT_EQ(segment.has_lab, 1U);
  EXPECT_EQ(segment.lab[0], 0);
  EXPECT_EQ(segment.lab[1], 127);
  EXPECT_NEAR(segment.lab[2], 0, 1e-12);
  std::memcpy(&segment, shared_.data() + sizeof(segment), sizeof(segment));
  EXPECT_EQ(segment.number, 300U);
  EXPECT_EQ(segment.has_lab, 0U);
}

TEST_F(DicomChildTest, BytesThatAreNoDicomFileAreNotDecoded) {
  WriteFile(path_, "Doe^Jane");
  for (const DicomQuestion question :
       {DicomQuestion::kFrames, DicomQuestion::kFrame, DicomQuestion::kSegments}) {
    const DicomAnswer answer = Ask(question, kSliceBytes);
    EXPECT_EQ(answer.outcome, DicomOutcome::kNotDecoded);
    EXPECT_EQ(answer.series[0], '\0');
  }
}

}  // namespace
}  // namespace isoscope::source
