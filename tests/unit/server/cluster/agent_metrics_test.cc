#include "server/cluster/agent_metrics.h"

#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

std::map<std::string, double> ValuesOf(const AgentMetrics& metrics) {
  std::vector<base::MetricFamily> families;
  metrics.AppendMetrics(&families);
  return testing::ValuesOf(families);
}

TEST(AgentMetricsTest, FailuresOfAgentsAreCountedByStageAndCode) {
  AgentMetrics metrics;
  metrics.CountFailure(PartStage::kRenderingVisible, absl::DataLossError(""));
  metrics.CountFailure(PartStage::kEnded, {static_cast<absl::StatusCode>(99), ""});
  auto values = ValuesOf(metrics);
  EXPECT_EQ(values["isoscope_agent_failures_total stage=rendering_visible_blocks code=DATA_LOSS"],
            1);
  EXPECT_EQ(values["isoscope_agent_failures_total stage=ended code=UNKNOWN"], 1);
}

TEST(AgentMetricsTest, AgentsBeyondTheBoundAreOneSeries) {
  AgentMetrics metrics;
  for (std::size_t i = 0; i < AgentMetrics::kMaxAgents + 5; ++i) {
    metrics.CountPart(absl::StrCat("10.0.0.", i, ":1"), AgentMetrics::PartOutcome::kDone);
  }
  auto values = ValuesOf(metrics);
  EXPECT_EQ(values["isoscope_agent_parts_total agent=10.0.0.0:1 outcome=done"], 1);
  EXPECT_EQ(values["isoscope_agent_parts_total agent=(other) outcome=done"], 5);
}

}  // namespace
}  // namespace isoscope::server
