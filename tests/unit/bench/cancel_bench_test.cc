#include "bench/cancel_bench.h"

#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/cli/interrupt.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::bench {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

TEST(CancelBenchReportTest, ColdAndFollowingFramesAreApart) {
  CancelBenchResult result;
  result.drawers.agent_count = 4;
  for (int i = 1; i <= 200; ++i) {
    result.frames.push_back({.is_cold = i % 2 == 0,
                             .moment_ms = 1,
                             .answer_ms = 0.5,
                             .idle_ms = static_cast<double>(i)});
  }
  const std::vector<std::string> lines = absl::StrSplit(DescribeCancelBench(result), '\n');
  ASSERT_GE(lines.size(), 4);
  EXPECT_THAT(lines[1], ::testing::MatchesRegex("cold +100 +101.00 +198.00 +200.00 .*"));
  EXPECT_THAT(lines[2], ::testing::MatchesRegex("following +100 +100.00 +197.00 +199.00 .*"));
  EXPECT_THAT(lines[3],
              ::testing::MatchesRegex("all +200 +100.50 +198.00 +200.00 +0.50 +0.50 +0.50"));
  CancelBenchPlan plan;
  plan.request.isovalue = 60;
  const auto json = nlohmann::json::parse(CancelBenchJson({.volume = "head"}, plan, result));
  EXPECT_EQ(json["isovalue"], 60.0);
  EXPECT_EQ(json["agents"], 4);
  EXPECT_EQ(json["idle_ms"]["median"], 100.5);
  EXPECT_EQ(json["idle_ms"]["p99"], 198.0);
  EXPECT_EQ(json["frames"].size(), 200);
  EXPECT_EQ(json["frames"][1]["cold"], true);

  result.frames.resize(1);
  EXPECT_THAT(DescribeCancelBench(result), HasSubstr("cold             0                -"));
}

TEST(RunCancelBenchTest, ADatasetThatIsNotThereIsAnError) {
  const TempDir folder;
  cli::Interrupt interrupt;
  std::ostringstream out;
  std::ostringstream err;
  CancelBenchPlan plan;
  plan.cluster.dataset_directory = folder.Sub("absent");
  EXPECT_THAT(RunCancelBench(plan, {.out = &out, .err = &err, .interrupt = &interrupt}),
              StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace isoscope::bench
