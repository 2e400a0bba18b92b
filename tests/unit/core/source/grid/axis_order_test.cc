#include "core/source/grid/axis_order.h"

#include <optional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(AxisOrderTest, LettersNameAxesFromTheSlowest) {
  struct Row {
    const char* letters;
    AxisOrder order;
  };
  for (const Row& row : std::vector<Row>{{"ZYX", {.z = 0, .y = 1, .x = 2}},
                                         {"TZYX", {.z = 1, .y = 2, .x = 3, .t = 0}},
                                         {"TCZYX", {.z = 2, .y = 3, .x = 4, .t = 0, .c = 1}},
                                         {"ZYXC", {.z = 0, .y = 1, .x = 2, .c = 3}},
                                         {"-ZY-X", {.z = 1, .y = 2, .x = 4}}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const AxisOrder order, ParseAxisOrder(row.letters));
    EXPECT_EQ(order, row.order) << row.letters;
    EXPECT_EQ(AxisLetters(order, std::string(row.letters).size()), row.letters);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const AxisOrder lower, ParseAxisOrder("tzyx"));
  EXPECT_EQ(lower.t, 0u);
  for (const char* letters : {"", "TZY", "XYZ", "ZYXX", "TTZYX", "ZYXQ", "Z Y X", "CYX"}) {
    EXPECT_THAT(ParseAxisOrder(letters),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(letters)))
        << letters;
  }
}

TEST(AxisOrderTest, LabelsAreWordsLettersOrVigrasTags) {
  EXPECT_EQ(AxisLetterOf(" Time "), 'T');
  EXPECT_EQ(AxisLetterOf("Z"), 'Z');
  EXPECT_EQ(AxisLetterOf("channel"), 'C');
  EXPECT_EQ(AxisLetterOf("pressure"), '?');
  EXPECT_EQ(AxisLetterOf(""), '?');
  EXPECT_THAT(AxisLabelsIn("tzyx"), ElementsAre("t", "z", "y", "x"));
  EXPECT_THAT(AxisLabelsIn("time, z, y, x"), ElementsAre("time", "z", "y", "x"));
  EXPECT_THAT(AxisLabelsIn("['t', 'z']"), ElementsAre("t", "z"));
  EXPECT_THAT(AxisLabelsIn("{\"axes\": [{\"key\": \"t\", \"typeFlags\": 8}, {\"key\":\"x\"}]}"),
              ElementsAre("t", "x"));
  EXPECT_THAT(AxisLabelsIn("{\"key\": \"t"), IsEmpty());
  EXPECT_THAT(AxisLabelsIn("{\"key\""), IsEmpty());
  EXPECT_THAT(AxisLabelsIn(""), IsEmpty());
}

TEST(AxisOrderTest, ThreeAxesNeedNoNames) {
  EXPECT_EQ(PlainAxisOrder({5, 1, 7}), (AxisOrder{.z = 0, .y = 1, .x = 2}));
  EXPECT_EQ(PlainAxisOrder({1, 93, 64, 1, 64}), (AxisOrder{.z = 1, .y = 2, .x = 4}));
  EXPECT_EQ(PlainAxisOrder({2, 93, 64, 64}), std::nullopt);
  EXPECT_EQ(PlainAxisOrder({1, 1, 64, 64}), std::nullopt);
  EXPECT_EQ(PlainAxisOrder({64, 64}), std::nullopt);
  EXPECT_EQ(AxisChoices(4), "TZYX, CZYX or ZYXC");
  EXPECT_EQ(AxisChoices(7), "");
}

}  // namespace
}  // namespace isoscope::source
