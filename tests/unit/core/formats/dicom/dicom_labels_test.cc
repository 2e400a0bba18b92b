#include "core/formats/dicom/dicom_labels.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/source_labels.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/dicom/segmentation_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::SegmentationBytes;
using ::isoscope::testing::SegmentationFile;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using volume::Label;
using volume::LabelColor;

class DicomLabelsTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::vector<Label>> Read(SegmentationFile file) {
    file.frames = {{.pixels = std::vector<int>(15, 1)}};
    testing::WriteFile(dir_.Sub("s.dcm"), SegmentationBytes(file));
    return ReadSourceLabels(dir_.Sub("s.dcm"));
  }
  testing::TempDir dir_;
};

constexpr std::array<std::uint16_t, 3> kLiver{41661, 41167, 40792};

TEST_F(DicomLabelsTest, SegmentsHaveNamesAndColoursByNumber) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto labels,
                                Read({.segments = {{7, "right lung"}, {3, "liver", kLiver}, {9}}}));
  EXPECT_THAT(labels, ElementsAre(Label{.value = 3, .name = "liver", .color = {{221, 130, 101}}},
                                  Label{.value = 7, .name = "right lung"}, Label{.value = 9}));
  // Of the only file of a folder, too.
  EXPECT_THAT(ReadDicomLabels(dir_.path()).value(), ElementsAre(labels[0], labels[1], labels[2]));
}

TEST_F(DicomLabelsTest, LettersAreThoseOfTheFile) {
  const std::vector<testing::NamedSegment> latin{{1, "K\xf6rper"}};
  EXPECT_THAT(Read({.segments = latin, .letters = "ISO_IR 100"}).value(),
              ElementsAre(Label{.value = 1, .name = "K\xc3\xb6rper"}));
  EXPECT_THAT(Read({.segments = {{1, "K\xc3\xb6rper"}}, .letters = "ISO_IR 192"}).value(),
              ElementsAre(Label{.value = 1, .name = "K\xc3\xb6rper"}));
  EXPECT_THAT(Read({.segments = latin}).value(), ElementsAre(Label{.value = 1, .name = "K?rper"}));
}

TEST_F(DicomLabelsTest, SharesAndOtherFilesHaveNone) {
  EXPECT_THAT(Read({.kind = "FRACTIONAL", .bits = 8, .segments = {{1, "liver"}}}).value(),
              IsEmpty());
  testing::WriteFile(dir_.Sub("s.dcm"), testing::DicomBytes({}, std::string(216, 'p')));
  EXPECT_THAT(ReadDicomLabels(dir_.Sub("s.dcm")).value(), IsEmpty());
  EXPECT_THAT(ReadDicomLabels(dir_.Sub("none.dcm")).value(), IsEmpty());
}

TEST_F(DicomLabelsTest, ANumberThatComesTwiceIsAnError) {
  EXPECT_THAT(Read({.segments = {{1, "a"}, {1, "b"}}}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("s.dcm")));
}

}  // namespace
}  // namespace isoscope::source
