#include "web-gateway/served_selection.h"

#include <initializer_list>
#include <string>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

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

TEST(ServedSelectionTest, OnlyAStepByItsNumberOrADatasetWithoutTimesStaysTheSame) {
  for (const char* const text : {"", "time_step: -1", "time: 1"}) {
    EXPECT_TRUE(DependsOnLaterSteps(Selection(text), MakeSeries())) << text;
  }
  EXPECT_FALSE(DependsOnLaterSteps(Selection("time_step: 0"), MakeSeries()));
  v1::Dataset without_times = MakeSeries();
  without_times.clear_time_steps();
  EXPECT_FALSE(DependsOnLaterSteps({}, without_times));
}

TEST(ServedSelectionTest, RangesCountWhereAMapHasNoneOfItsOwn) {
  v1::RenderIsosurfaceRequest request;
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "");
  request.add_surfaces()->mutable_color_by()->mutable_range();
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "");
  request.mutable_caps();  // of the surface's colour
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "");
  request.mutable_caps()->set_color_map(v1::COLOR_MAP_GREY);
  EXPECT_NE(RangesOfColors(request, MakeSeries()), "");
  request.mutable_caps()->mutable_range();
  request.add_surfaces()->mutable_color_by();
  const std::string before = RangesOfColors(request, MakeSeries());
  v1::Dataset later = MakeSeries();
  later.mutable_fields(1)->mutable_components(2)->mutable_value_range()->set_max(9);
  EXPECT_NE(RangesOfColors(request, later), before);
  EXPECT_EQ(RangesOfColors(request, v1::Dataset()), "") << "a dataset of one field";
}

}  // namespace
}  // namespace isoscope::gateway
