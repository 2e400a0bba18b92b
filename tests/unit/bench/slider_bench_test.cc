#include "bench/slider_bench.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::bench {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

SliderBenchResult Result() {
  SliderBenchResult result;
  result.drawers = {1, "cpu"};
  result.is_in_process = true;
  result.first = {{60, 40, 4, 2}, {61, 20, 2, 0}, {62, 30, 3, 1}};
  result.second = {{60, 10, 1, 0}, {61, 12, 1, 0}, {62, 14, 1, 0}};
  result.is_repeatable = true;
  return result;
}

TEST(SliderBenchTest, TheTextHasARowForEachPass) {
  const std::string text = DescribeSliderBench(Result());
  EXPECT_THAT(text, HasSubstr("for the first time    30.0 ms    40.0 ms     3.0 ms       1.0 MiB"));
  EXPECT_THAT(text, HasSubstr("once more             12.0 ms    14.0 ms     1.0 ms       0.0 MiB"));
  EXPECT_THAT(text, HasSubstr("\nthe same bytes both times"));
}

TEST(SliderBenchTest, PicturesThatDifferAreSaid) {
  SliderBenchResult result = Result();
  result.is_repeatable = false;
  EXPECT_THAT(DescribeSliderBench(result), HasSubstr("NOT the same bytes"));
}

TEST(SliderBenchTest, AServersMemoryIsNotGuessedFromTheClients) {
  SliderBenchResult result = Result();
  result.is_in_process = false;
  EXPECT_THAT(DescribeSliderBench(result), Not(HasSubstr("MiB")));
}

TEST(SliderBenchTest, TheJsonHasTheSameFigures) {
  SliderBenchPlan plan;
  plan.request.isovalue = 60;
  plan.last_isovalue = 62;
  const auto json = nlohmann::json::parse(SliderBenchJson({.volume = "head"}, plan, Result()));
  EXPECT_EQ(json["new"]["median_ms"], 30);
  EXPECT_EQ(json["new"]["median_grown_mib"], 1);
  EXPECT_EQ(json["again"]["p95_ms"], 14);
  EXPECT_EQ(json["isovalues"][1], 62);
}

}  // namespace
}  // namespace isoscope::bench
