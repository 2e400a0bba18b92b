#include "client-cli/terminal/view_labels.h"

#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "clients/cpp/request/label_flags.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

TEST(TextOfValuesTest, RunsOfThreeAndMoreAreRanges) {
  EXPECT_EQ(TextOfValues({3}), "3");
  EXPECT_EQ(TextOfValues({3, 4}), "3,4");
  EXPECT_EQ(TextOfValues({-2, -1, 0, 1, 2, 7, 9.5}), "-2,-1,0-2,7,9.5");
}

// What is printed at the end of a view is parsed to the same surfaces.
TEST(FlagsOfLabelsTest, EachSurfaceComesBackFromItsFlag) {
  isoscope::v1::Dataset dataset;
  client::LabelFlags flags;
  for (const char* const text : {"1", "3,7-9:1,0.25,0.333333343:0.4", "4::0.5"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::LabelValue given, client::ParseLabel(text));
    flags.sets.push_back(given);
  }
  ISOSCOPE_ASSERT_OK(client::ResolveLabels(dataset, /*present=*/std::nullopt, &flags));
  EXPECT_EQ(FlagsOfLabels(flags.surfaces),
            "--label 1 --label 3,7-9:1,0.25,0.333333343:0.400000006 --label 4::0.5");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::LabelValue again,
                                client::ParseLabel("3,7-9:1,0.25,0.333333343:0.400000006"));
  EXPECT_EQ(again.opacity, flags.sets[1].opacity);
  EXPECT_EQ(again.color, flags.sets[1].color);
}

TEST(FlagsOfLabelsTest, SmoothLabelsHaveOneFlag) {
  EXPECT_EQ(FlagsOfLabels({{.values = {1}, .is_smooth = true}, {.values = {2}, .is_smooth = true}}),
            "--label 1 --label 2 --smooth-labels");
  EXPECT_EQ(FlagsOfLabels({}), "");
}

}  // namespace
}  // namespace isoscope::cli
