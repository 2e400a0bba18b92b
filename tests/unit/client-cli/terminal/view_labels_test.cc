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

TEST(ShownLabelsTest, AroundAHighlightedOneTheOthersAreFaintButNoMoreThanBefore) {
  const std::vector<client::LabelSurface> labels = {{.values = {1}, .color = {1, 0, 0, 0.5F}},
                                                    {.values = {2}},
                                                    {.values = {3}, .color = {0, 1, 0, 0.1F}}};
  LabelChoice choice(labels.size(), /*shows_others=*/false);
  EXPECT_EQ(ShownLabels(labels, choice), labels);
  choice.ToggleHighlight();
  std::vector<client::LabelSurface> shown = labels;
  shown[0].color.alpha = 1;
  shown[1].color.alpha = 0.15F;
  EXPECT_EQ(ShownLabels(labels, choice), shown);
  choice.ToggleHidden();
  EXPECT_EQ(ShownLabels(labels, choice), (std::vector<client::LabelSurface>{labels[1], labels[2]}));
}

TEST(DescribeLabelsTest, SaysWhichAreShown) {
  const std::vector<client::LabelSurface> labels = {{.values = {1}, .name = "left lung"},
                                                    {.values = {2}, .name = "label 2"}};
  LabelChoice choice(labels.size(), /*shows_others=*/false);
  EXPECT_EQ(DescribeLabels(labels, choice), "2 labels");
  choice.Step(true);
  EXPECT_EQ(DescribeLabels(labels, choice), "left lung (1 of 2)");
  choice.ToggleHighlight();
  EXPECT_EQ(DescribeLabels(labels, choice), "left lung (1 of 2) highlighted");
  choice.ToggleHidden();
  EXPECT_EQ(DescribeLabels(labels, choice), "1 of 2 labels");
  EXPECT_EQ(DescribeLabels({labels[0]}, LabelChoice(1, /*shows_others=*/false)), "left lung");
}

}  // namespace
}  // namespace isoscope::cli
