// Asks the handler for lists of frames, in this process: GDCM is behind it.

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/dicom/dicom_child.h"
#include "tests/support/dicom_file.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomItem;
using ::isoscope::testing::DicomNumber;
using ::isoscope::testing::WriteFile;
using ::testing::ElementsAre;

class DicomFrameListTest : public ::testing::Test {
 protected:
  // The answer for a file of one frame, or of two.
  DicomAnswer List(testing::DicomSlice slice) {
    slice.width = 4;
    slice.height = 3;
    const std::size_t frames = slice.frames == 0 ? 1 : 2;
    WriteFile(path_, DicomBytes(slice, std::string(frames * 24, 'p')));
    DicomRequest request{};
    path_.copy(request.path.data(), path_.size());
    DicomAnswer answer{};
    DecodeDicomInChild(&request, &answer, shared_.data());
    EXPECT_EQ(answer.outcome, DicomOutcome::kHeader);
    return answer;
  }
  DicomFrameRecord Frame(std::size_t index) const {
    DicomFrameRecord record;
    std::memcpy(&record, shared_.data() + index * sizeof(record), sizeof(record));
    return record;
  }

  testing::TempDir dir_;
  const std::string path_ = dir_.Sub("a.dcm");
  std::string shared_ = std::string(kDicomListBytes, '?');
};

// Numbers of 16 or 32 bits in one element.
template <typename T>
std::string Numbers(const std::vector<T>& numbers) {
  std::string bytes;
  for (const T number : numbers) {
    bytes += DicomNumber(number);
  }
  return bytes;
}

TEST_F(DicomFrameListTest, NumbersThatAreHalfGivenOrNoneAreBroken) {
  struct Case {
    const char* text;
    DicomGiven given;
  };
  for (const Case& c : {Case{"1\\2\\3", DicomGiven::kGiven},
                        {" 1\\ 2 \\3 ", DicomGiven::kGiven},
                        {"1\\2", DicomGiven::kBroken},
                        {"1\\2\\3\\4", DicomGiven::kBroken},
                        {"1\\\\3", DicomGiven::kBroken},
                        {"1\\2\\nan", DicomGiven::kBroken},
                        {"1\\inf\\3", DicomGiven::kBroken},
                        {"1e999\\2\\3", DicomGiven::kBroken},
                        {"1\\2\\3mm", DicomGiven::kBroken},
                        {"1,5\\2\\3", DicomGiven::kBroken},
                        {"  ", DicomGiven::kMissing},
                        {"", DicomGiven::kMissing}}) {
    List({.position = c.text});
    EXPECT_EQ(Frame(0).position.given, c.given) << c.text;
    EXPECT_EQ(Frame(0).position.values[1], c.given == DicomGiven::kGiven ? 2 : 0) << c.text;
  }
}

TEST_F(DicomFrameListTest, PhotometricInterpretationsAndTablesAreTold) {
  for (const auto& [text, photometric] :
       {std::pair("MONOCHROME1", DicomPhotometric::kMonochrome),
        std::pair("PALETTE COLOR", DicomPhotometric::kPalette),
        std::pair("RGB", DicomPhotometric::kColour),
        std::pair("YBR_FULL", DicomPhotometric::kColour),
        std::pair("ARGB", DicomPhotometric::kOther), std::pair("", DicomPhotometric::kMissing)}) {
    EXPECT_EQ(List({.photometric = text}).photometric, photometric) << text;
  }
  const std::string item = DicomItem(DicomElement(0x28, 0x3003, "LO", "x"));
  EXPECT_EQ(List({.more = DicomElement(0x28, 0x3000, "SQ", item)}).has_lut, 1U);
  EXPECT_EQ(List({.more = DicomElement(0x28, 0x3000, "SQ", "")}).has_lut, 0U);
}

TEST_F(DicomFrameListTest, DetectorsSayWhereTheirFramesLie) {
  const std::string detectors = DicomItem(DicomElement(0x20, 0x32, "DS", "1\\2\\3")) +
                                DicomItem(DicomElement(0x20, 0x37, "DS", "0\\1\\0\\0\\0\\1"));
  const DicomAnswer answer =
      List({.more = DicomElement(0x54, 0x20, "US", Numbers<std::uint16_t>({2, 1})) +
                    DicomElement(0x54, 0x22, "SQ", detectors) +
                    DicomElement(0x54, 0x80, "US", Numbers<std::uint16_t>({5, 4})),
            .frames = 2});
  EXPECT_THAT(Frame(0).position.values, ElementsAre(10, 20, 30)) << "that of the data set";
  EXPECT_THAT(Frame(0).orientation.values, ElementsAre(0, 1, 0, 0, 0, 1));
  EXPECT_THAT(Frame(1).position.values, ElementsAre(1, 2, 3));
  EXPECT_THAT(Frame(1).orientation.values, ElementsAre(1, 0, 0, 0, 1, 0));
  EXPECT_EQ(answer.dimensions[0], 0x00540080U) << "no pointer names it";
  EXPECT_EQ(answer.dimensions[1], 0U);
  EXPECT_EQ(Frame(0).indices[0], 5U);
  EXPECT_EQ(Frame(1).indices[0], 4U);
  // Without a vector all are of the first one.
  List({.more = DicomElement(0x54, 0x22, "SQ", detectors), .frames = 2});
  EXPECT_THAT(Frame(1).position.values, ElementsAre(1, 2, 3));
  EXPECT_THAT(Frame(1).orientation.values, ElementsAre(1, 0, 0, 0, 1, 0));
}

TEST_F(DicomFrameListTest, VectorsOfNuclearMedicineAreDimensionsInTheOrderOfTheirPointers) {
  const auto list = [this](const std::string& slices) {
    return List({.more = DicomElement(0x54, 0x10, "US", Numbers<std::uint16_t>({2, 1})) + slices,
                 .frames = 2});
  };
  const std::string slices = DicomElement(0x54, 0x80, "US", Numbers<std::uint16_t>({1, 2}));
  EXPECT_EQ(list(slices).increments[0], 0U);
  const std::string pointers =
      DicomElement(0x28, 9, "AT", Numbers<std::uint16_t>({0x54, 0x10, 0x54, 0x80}));
  const DicomAnswer answer = list(pointers + slices);
  EXPECT_EQ(answer.increments[1], 0x00540080U);
  EXPECT_EQ(answer.dimensions[0], 0x00540010U);
  EXPECT_EQ(answer.dimensions[1], 0x00540080U);
  EXPECT_EQ(answer.dimensions[2], 0U);
  EXPECT_EQ(Frame(0).indices[0], 2U);
  EXPECT_EQ(Frame(0).indices[1], 1U);
  EXPECT_EQ(Frame(1).indices[1], 2U);
  // A vector that is too short is none.
  EXPECT_EQ(
      list(pointers + DicomElement(0x54, 0x80, "US", Numbers<std::uint16_t>({1}))).dimensions[1],
      0U);
}

TEST_F(DicomFrameListTest, OffsetsOfDosesAreAsManyAsFramesOrBroken) {
  for (const auto& [text, given] :
       {std::pair("0\\3", DicomGiven::kGiven), std::pair("0\\3\\6", DicomGiven::kBroken),
        std::pair("0", DicomGiven::kBroken), std::pair("0\\x", DicomGiven::kBroken),
        std::pair("", DicomGiven::kMissing)}) {
    const DicomAnswer answer = List(
        {.more = DicomElement(0x3004, 0xc, "DS", text) + DicomElement(0x3004, 0xe, "DS", "0.25"),
         .frames = 2});
    EXPECT_EQ(answer.offsets, given) << text;
    EXPECT_EQ(answer.dose_scaling.value(), 0.25);
    EXPECT_EQ(Frame(1).offset, given == DicomGiven::kGiven ? 3 : 0);
  }
}

TEST_F(DicomFrameListTest, GroupsOfAFrameHideThoseOfAllAlsoIfTheyAreBroken) {
  const auto measures = [](const char* spacing) {
    return DicomElement(0x28, 0x9110, "SQ", DicomItem(DicomElement(0x28, 0x30, "DS", spacing)));
  };
  const DicomAnswer answer =
      List({.more = DicomElement(0x5200, 0x9229, "SQ", DicomItem(measures("3\\4"))) +
                    DicomElement(0x5200, 0x9230, "SQ",
                                 DicomItem(measures("5")) + DicomItem(measures(""))),
            .frames = 2});
  EXPECT_EQ(answer.group_items, 2U);
  EXPECT_EQ(Frame(0).pixel_spacing.given, DicomGiven::kBroken);
  EXPECT_THAT(Frame(1).pixel_spacing.values, ElementsAre(3, 4)) << "an empty one is none";
}

TEST_F(DicomFrameListTest, IndicesOfAFrameAreAsManyAsDimensionsOrNone) {
  const auto dimension = [](std::uint16_t element) {
    return DicomItem(DicomElement(0x20, 0x9165, "AT", Numbers<std::uint16_t>({0x20, element})));
  };
  const auto frame = [](const std::vector<std::uint32_t>& indices) {
    const std::string content = DicomItem(DicomElement(0x20, 0x9157, "UL", Numbers(indices)));
    return DicomItem(DicomElement(0x20, 0x9111, "SQ", content));
  };
  const DicomAnswer answer =
      List({.more = DicomElement(0x20, 0x9222, "SQ", dimension(0x9057) + dimension(0x9128)) +
                    DicomElement(0x5200, 0x9230, "SQ", frame({7, 8}) + frame({9})),
            .frames = 2});
  EXPECT_EQ(answer.dimensions[0], 0x00209057U);
  EXPECT_EQ(answer.dimensions[1], 0x00209128U);
  EXPECT_EQ(Frame(0).indices[0], 7U);
  EXPECT_EQ(Frame(0).indices[1], 8U);
  EXPECT_EQ(Frame(1).indices[0], 0U);
}

}  // namespace
}  // namespace isoscope::source
