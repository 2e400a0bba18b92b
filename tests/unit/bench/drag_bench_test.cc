#include "bench/drag_bench.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::bench {
namespace {

using ::testing::HasSubstr;

DragBenchResult Result() {
  DragBenchResult result;
  result.drawers = {2, "cpu"};
  result.drag_seconds = 2;
  result.frame_count = 3;
  result.latencies_ms = {10, 30, 20};
  result.heights_px = {512, 1024, 1024};
  result.frame_bytes = {2048, 1024, 4096};
  result.exact_ms = 150;
  result.exact_is_that_of_render = true;
  return result;
}

TEST(DragBenchTest, TheTextSaysRateLatencySizeAndWhetherTheExactFrameIsExact) {
  DragBenchResult result = Result();
  const std::string text = DescribeDragBench(result);
  EXPECT_THAT(text, HasSubstr("1.5 frames a second (3 in 2.0 s)"));
  EXPECT_THAT(text, HasSubstr("20 ms median, 30 ms p95"));
  EXPECT_THAT(text, HasSubstr("1024 pixels high and 2 KiB"));
  EXPECT_THAT(text, HasSubstr("exact 150 ms after the last state, the bytes"));
  result.exact_is_that_of_render = false;
  EXPECT_THAT(DescribeDragBench(result), HasSubstr("NOT the bytes"));
}

TEST(DragBenchTest, TheJsonHasTheSameFigures) {
  DragBenchPlan plan;
  plan.request.isovalue = 60;
  const auto json = nlohmann::json::parse(DragBenchJson({.volume = "head"}, plan, Result()));
  EXPECT_EQ(json["frames_per_second"], 1.5);
  EXPECT_EQ(json["latency_ms"]["median"], 20);
  EXPECT_EQ(json["latency_ms"]["p95"], 30);
  EXPECT_EQ(json["median_height_px"], 1024);
  EXPECT_EQ(json["volume"], "head");
  EXPECT_EQ(json["isovalue"], 60);
}

TEST(DragBenchTest, NoFrameAtAllIsARateOfZero) {
  EXPECT_THAT(DescribeDragBench(DragBenchResult()), HasSubstr("0.0 frames a second"));
}

}  // namespace
}  // namespace isoscope::bench
