#include "wire/field_selection.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/served_series.h"
#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::MakeSeries;
using ::isoscope::testing::Selection;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(FieldSelectionTest, OpenPartsAreWhatTheDatasetServes) {
  const struct {
    const char* asked;
    const char* served;  // "": an error
  } cases[] = {
      {"", R"(field: "pressure" time_step: 4)"},
      {"time_step: -1", R"(field: "pressure" time_step: 4)"},
      {"time_step: 2", R"(field: "pressure" time_step: 2)"},
      {"time_step: 1", ""},
      {"time_step: 9", ""},
      {"time_step: -2", ""},
      {R"(field: "hue")", ""},
      {R"(component: "x")", ""},
      {R"(field: "velocity")", R"(field: "velocity" component: "magnitude" time_step: 3)"},
      {R"(field: "velocity" component: "y" time_step: 0)",
       R"(field: "velocity" component: "y" time_step: 0)"},
      {R"(field: "velocity" component: "1" time_step: 0)",
       R"(field: "velocity" component: "y" time_step: 0)"},  // by its number
      {R"(field: "velocity" component: "3")", ""},           // the magnitude has none
      {R"(field: "velocity" component: "w")", ""},
      {R"(field: "velocity" time_step: 4)", ""},
      {"time: -100", R"(field: "pressure" time_step: 0)"},
      {"time: 0.5", R"(field: "pressure" time_step: 0)"},  // as near to 1
      {"time: 0.5000001", R"(field: "pressure" time_step: 2)"},
      {"time: 1e9", R"(field: "pressure" time_step: 4)"},
      {"time: nan", ""},
      {"time: 1e300", R"(field: "pressure" time_step: 4)"},
      {R"(field: "velocity" time: 1e9)",
       R"(field: "velocity" component: "magnitude" time_step: 3)"},
  };
  for (const auto& c : cases) {
    const absl::StatusOr<v1::FieldSelection> served =
        ResolveSelection(Selection(c.asked), MakeSeries());
    EXPECT_EQ(served.ok() ? served->ShortDebugString() : "", c.served) << c.asked;
  }
}

TEST(FieldSelectionTest, ADatasetWithoutTimesHasNoStepToChoose) {
  v1::Dataset dataset = MakeSeries();
  dataset.clear_time_steps();
  EXPECT_EQ(ResolveSelection({}, dataset)->ShortDebugString(), R"(field: "pressure")");
}

TEST(FieldSelectionTest, AFieldWithoutComponentsIsAnErrorAndNoCrash) {
  v1::Dataset dataset = MakeSeries();
  dataset.mutable_fields(0)->clear_components();
  EXPECT_THAT(ResolveSelection({}, dataset),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no components")));
}

TEST(FieldSelectionTest, MessagesSayWhichStepsThereAre) {
  const struct {
    std::vector<int> steps;
    const char* text;
  } cases[] = {{{}, "none"}, {{7}, "7"}, {{0, 1, 2}, "0 to 2"}, {{0, 2, 5}, "0, 2, 5"}};
  for (const auto& c : cases) {
    EXPECT_EQ(DescribeSteps(c.steps), c.text);
  }
  std::vector<int> many;
  for (int step = 0; step < 40; step += 2) {
    many.push_back(step);
  }
  EXPECT_THAT(DescribeSteps(many), HasSubstr("28, 30, ... (20 in all)"));
}

}  // namespace
}  // namespace isoscope::wire
