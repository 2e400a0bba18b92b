#include "partition-agent/memory/agent_metrics.h"

#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::agent {
namespace {

using testing::ValuesOf;

TEST(AgentMetricsTest, OnlyFramesThatEndedWellCountAsBusy) {
  AgentMetrics metrics;
  metrics.CountFrame(absl::OkStatus(), absl::Milliseconds(250));
  metrics.CountFrame(absl::CancelledError(""), absl::Seconds(9));
  metrics.CountFrame(absl::DataLossError(""), absl::Seconds(9));
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_agent_frames_total outcome=done"], 1);
  EXPECT_EQ(values["isoscope_agent_frames_total outcome=failed"], 1);
  EXPECT_EQ(values["isoscope_agent_frames_total outcome=cancelled"], 1);
  EXPECT_DOUBLE_EQ(values["isoscope_agent_busy_seconds_total"], 0.25);
}

TEST(AgentMetricsTest, EachCacheHasItsHitsMissesAndBytes) {
  AgentMetrics metrics;
  metrics.mesh_lookups.hits.Add(10);
  metrics.mesh_lookups.misses.Add(3);
  metrics.sample_lookups.hits.Add(2);
  metrics.sample_lookups.misses.Add(1);
  metrics.active_lookups.hits.Add(7);
  metrics.active_lookups.misses.Add(4);
  auto values = ValuesOf(metrics.Collect(
      {.mesh_cache_bytes = 100, .sample_cache_bytes = 200, .active_cache_bytes = 300}));
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=meshes result=hit"], 10);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=meshes result=miss"], 3);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=samples result=hit"], 2);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=samples result=miss"], 1);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=active_blocks result=hit"], 7);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=active_blocks result=miss"], 4);
  EXPECT_EQ(values["isoscope_cache_bytes cache=samples"], 200);
}

TEST(AgentMetricsTest, NamesFollowTheConvention) {
  AgentMetrics metrics;
  metrics.CountRequest(AgentMethod::kGetGradients, absl::OkStatus(), absl::Seconds(1));
  testing::ExpectNamesFollowTheConvention(metrics.Collect({}));
  EXPECT_EQ(ValuesOf(metrics.Collect({}))["isoscope_requests_total method=GetGradients code=OK"],
            1);
}

}  // namespace
}  // namespace isoscope::agent
