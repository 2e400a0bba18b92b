#include "core/rpc/field_selection.h"

#include <initializer_list>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

void AddField(v1::Dataset* dataset, const std::string& name,
              std::initializer_list<const char*> components, std::initializer_list<int> steps) {
  v1::Field& field = *dataset->add_fields();
  field.set_name(name);
  for (const char* const component : components) {
    field.add_components()->set_name(component);
  }
  for (const int step : steps) {
    field.add_time_steps(step);
  }
}

// Four steps, of which the agents have no number 1; velocity lags by one.
v1::Dataset MakeSeries() {
  v1::Dataset dataset;
  for (const int number : {0, 2, 3, 4}) {
    v1::TimeStep& step = *dataset.add_time_steps();
    step.set_number(number);
    step.set_value(number * 0.5);
  }
  AddField(&dataset, "pressure", {""}, {0, 1, 2, 3});
  AddField(&dataset, "velocity", {"x", "y", "z", "magnitude"}, {0, 1, 2});
  return dataset;
}

v1::FieldSelection Selection(const std::string& text) {
  v1::FieldSelection selection;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &selection)) << text;
  return selection;
}

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
  EXPECT_EQ(QuotedName("a\n\"b"), R"("a\n\"b")");
  EXPECT_EQ(QuotedName(std::string(500, 'a')).size(), 102);
}

}  // namespace
}  // namespace isoscope::rpc
