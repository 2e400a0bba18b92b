#include "client-cli/terminal/label_choice.h"

#include <cstddef>
#include <optional>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using Look = LabelChoice::Look;
using ::testing::ElementsAre;

std::vector<Look> Looks(const LabelChoice& choice, std::size_t count) {
  std::vector<Look> looks;
  for (std::size_t i = 0; i < count; ++i) {
    looks.push_back(choice.LookOf(i));
  }
  return looks;
}

TEST(LabelChoiceTest, AHiddenLabelStaysAwayFromAllAndIsLeftOutByTheNextOnes) {
  LabelChoice choice(3, /*shows_others=*/false);
  EXPECT_FALSE(choice.ToggleHidden()) << "none is chosen";
  EXPECT_TRUE(choice.Step(true));
  EXPECT_TRUE(choice.Step(true));
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kHidden, Look::kPlain, Look::kHidden));
  EXPECT_TRUE(choice.ToggleHidden());
  EXPECT_EQ(choice.chosen(), std::nullopt);
  EXPECT_EQ(choice.hidden_count(), 1);
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kPlain, Look::kHidden, Look::kPlain));
  EXPECT_TRUE(choice.Step(true));
  EXPECT_EQ(choice.chosen(), 2) << "the one behind it follows";
  EXPECT_TRUE(choice.Step(false));
  EXPECT_EQ(choice.chosen(), 0) << "it is left out";
  EXPECT_TRUE(choice.ShowAll());
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kPlain, Look::kPlain, Look::kPlain));
  EXPECT_FALSE(choice.ShowAll());
}

TEST(LabelChoiceTest, TheSameKeyShowsALabelAgain) {
  LabelChoice choice(2, /*shows_others=*/false);
  choice.Step(true);
  EXPECT_TRUE(choice.ToggleHidden());
  EXPECT_TRUE(choice.ToggleHidden());
  EXPECT_EQ(choice.chosen(), 0);
  EXPECT_EQ(choice.hidden_count(), 0);
}

TEST(LabelChoiceTest, TheLastSurfaceOfAViewIsNotHidden) {
  LabelChoice choice(2, /*shows_others=*/false);
  choice.Step(true);
  EXPECT_TRUE(choice.ToggleHidden());
  choice.Step(true);
  EXPECT_FALSE(choice.ToggleHidden());
  EXPECT_THAT(Looks(choice, 2), ElementsAre(Look::kHidden, Look::kPlain));
  LabelChoice beside(1, /*shows_others=*/true);
  beside.Step(true);
  EXPECT_TRUE(beside.ToggleHidden());
  EXPECT_THAT(Looks(beside, 1), ElementsAre(Look::kHidden));
  EXPECT_FALSE(beside.ToggleHighlight()) << "none is left";
  EXPECT_FALSE(beside.is_highlighted());
}

TEST(LabelChoiceTest, AHighlightGoesFromLabelToLabelAndEnds) {
  LabelChoice choice(3, /*shows_others=*/false);
  EXPECT_TRUE(choice.ToggleHighlight());
  EXPECT_TRUE(choice.is_highlighted());
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kHighlighted, Look::kFaint, Look::kFaint));
  choice.Step(true);
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kFaint, Look::kHighlighted, Look::kFaint));
  choice.ToggleHidden();
  EXPECT_FALSE(choice.is_highlighted()) << "what is hidden is not highlighted";
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kPlain, Look::kHidden, Look::kPlain));
  choice.Step(true);
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kFaint, Look::kHidden, Look::kHighlighted));
  EXPECT_TRUE(choice.ToggleHighlight());
  EXPECT_THAT(Looks(choice, 3), ElementsAre(Look::kHidden, Look::kHidden, Look::kPlain));
}

TEST(LabelChoiceTest, WithoutLabelsNothingChanges) {
  LabelChoice choice(0, /*shows_others=*/true);
  EXPECT_FALSE(choice.Step(true));
  EXPECT_FALSE(choice.ToggleHidden());
  EXPECT_FALSE(choice.ToggleHighlight());
  EXPECT_FALSE(choice.ShowAll());
}

}  // namespace
}  // namespace isoscope::cli
