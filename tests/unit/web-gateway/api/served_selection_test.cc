#include "web-gateway/api/served_selection.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/served_series.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::MakeSeries;
using ::isoscope::testing::Selection;

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
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "");
  request.mutable_caps()->mutable_range()->mutable_percentiles();
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "") << "of the step's samples";
  request.mutable_caps()->mutable_range()->set_source(v1::ColorRange::SOURCE_STEP);
  EXPECT_EQ(RangesOfColors(request, MakeSeries()), "");
  request.mutable_caps()->mutable_range()->set_source(v1::ColorRange::SOURCE_VISIBLE);
  EXPECT_NE(RangesOfColors(request, MakeSeries()), "") << "it is found within that of all steps";
  request.mutable_caps()->mutable_range()->Clear();
  request.add_surfaces()->mutable_color_by();
  const std::string before = RangesOfColors(request, MakeSeries());
  v1::Dataset later = MakeSeries();
  later.mutable_fields(1)->mutable_components(2)->mutable_value_range()->set_max(9);
  EXPECT_NE(RangesOfColors(request, later), before);
  EXPECT_EQ(RangesOfColors(request, v1::Dataset()), "") << "a dataset of one field";
}

}  // namespace
}  // namespace isoscope::gateway
