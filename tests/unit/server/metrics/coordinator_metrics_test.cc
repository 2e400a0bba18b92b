#include "server/metrics/coordinator_metrics.h"

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

using testing::ValuesOf;

TEST(CoordinatorMetricsTest, FramesAreCountedByOutcomeAndCancelledOnesHaveNoDuration) {
  CoordinatorMetrics metrics;
  metrics.CountFrame(absl::OkStatus(), absl::Seconds(1), false, "a");
  metrics.CountFrame(absl::UnavailableError(""), absl::Seconds(1), false, "a");
  metrics.CountFrame(absl::CancelledError(""), absl::Seconds(1), false, "a");
  metrics.CountFrame(absl::OkStatus(), absl::Milliseconds(20), true, "");
  metrics.CountRefused("a");
  metrics.frames.refused.Add();
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_frames_total outcome=done"], 2);
  EXPECT_EQ(values["isoscope_frames_total outcome=failed"], 1);
  EXPECT_EQ(values["isoscope_frames_total outcome=cancelled"], 1);
  EXPECT_EQ(values["isoscope_frames_total outcome=refused"], 1);
  EXPECT_EQ(values["isoscope_frame_duration_seconds kind=exact"], 2);
  EXPECT_EQ(values["isoscope_frame_duration_seconds kind=moving"], 1);
  EXPECT_EQ(values["isoscope_caller_frames_total caller=a outcome=done"], 1);
  EXPECT_EQ(values["isoscope_caller_frames_total caller=a outcome=refused"], 1);
  EXPECT_EQ(values["isoscope_caller_frames_total caller=(no token) outcome=done"], 1);
}

TEST(CoordinatorMetricsTest, FramesThatWereNotDrawnAreCountedByReason) {
  CoordinatorMetrics metrics;
  metrics.frames.refused.Add(5);
  metrics.frames.displaced.Add(2);
  metrics.frames.expired.Add();
  metrics.frames.too_large.Add(7);
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=queue_full"], 3);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=made_room"], 2);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=deadline"], 1);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=token_rate"], 0);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=memory_limit"], 7);
}

TEST(CoordinatorMetricsTest, FailuresOfAgentsAreCountedByStageAndCode) {
  CoordinatorMetrics metrics;
  metrics.CountAgentFailure(PartStage::kRenderingVisible, absl::DataLossError(""));
  metrics.CountAgentFailure(PartStage::kEnded, {static_cast<absl::StatusCode>(99), ""});
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_agent_failures_total stage=rendering_visible_blocks code=DATA_LOSS"],
            1);
  EXPECT_EQ(values["isoscope_agent_failures_total stage=ended code=UNKNOWN"], 1);
}

TEST(CoordinatorMetricsTest, AgentsBeyondTheBoundAreOneSeries) {
  CoordinatorMetrics metrics;
  for (std::size_t i = 0; i < CoordinatorMetrics::kMaxAgents + 5; ++i) {
    metrics.CountPart(absl::StrCat("10.0.0.", i, ":1"), CoordinatorMetrics::PartOutcome::kDone);
  }
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_agent_parts_total agent=10.0.0.0:1 outcome=done"], 1);
  EXPECT_EQ(values["isoscope_agent_parts_total agent=(other) outcome=done"], 5);
}

TEST(CoordinatorMetricsTest, EveryMethodHasItsName) {
  CoordinatorMetrics metrics;
  metrics.CountRequest(RequestMethod::kRenderIsosurface, absl::OkStatus(), absl::Seconds(1));
  metrics.CountRequest(RequestMethod::kGetClusterStatus, absl::OkStatus(), absl::Seconds(1));
  metrics.CountRequest(RequestMethod::kInteract, absl::NotFoundError(""), absl::Seconds(1));
  auto values = ValuesOf(metrics.Collect({}));
  EXPECT_EQ(values["isoscope_requests_total method=RenderIsosurface code=OK"], 1);
  EXPECT_EQ(values["isoscope_requests_total method=GetClusterStatus code=OK"], 1);
  EXPECT_EQ(values["isoscope_requests_total method=Interact code=NOT_FOUND"], 1);
  EXPECT_EQ(values["isoscope_request_duration_seconds method=GetClusterStatus"], 1);
}

TEST(CoordinatorMetricsTest, GaugesAreThoseThatWereGiven) {
  auto values = ValuesOf(CoordinatorMetrics().Collect({.working_frames = 3,
                                                       .queued_frames = 7,
                                                       .waiting_clients = 6,
                                                       .outside_clients = 9,
                                                       .max_working_frames = 4,
                                                       .max_queued_frames = 32,
                                                       .reachable_agents = 5,
                                                       .unreachable_agents = 1,
                                                       .opening_agents = 4,
                                                       .damaged_shards = 5,
                                                       .complete_datasets = 2,
                                                       .incomplete_datasets = 8,
                                                       .memory_limit_bytes = 1 << 30,
                                                       .frame_memory_bytes = 12345,
                                                       .certificate_days_left = 6.5,
                                                       .certificate_failures = 2,
                                                       .token_failures = 1,
                                                       .audit_lines = 10,
                                                       .audit_failures = 3}));
  EXPECT_EQ(values["isoscope_admission_frames state=working"], 3);
  EXPECT_EQ(values["isoscope_admission_frames state=queued"], 7);
  EXPECT_EQ(values["isoscope_admission_limit_frames state=queued"], 32);
  EXPECT_EQ(values["isoscope_admission_clients state=queued"], 6);
  EXPECT_EQ(values["isoscope_admission_clients state=refused"], 9);
  EXPECT_EQ(values["isoscope_agents state=reachable"], 5);
  EXPECT_EQ(values["isoscope_agents state=unreachable"], 1);
  EXPECT_EQ(values["isoscope_agents state=opening"], 4);
  EXPECT_EQ(values["isoscope_damaged_shards"], 5);
  EXPECT_EQ(values["isoscope_datasets state=incomplete"], 8);
  EXPECT_EQ(values["isoscope_memory_limit_bytes"], 1 << 30);
  EXPECT_EQ(values["isoscope_frame_memory_bytes"], 12345);
  EXPECT_EQ(values["isoscope_certificate_days_left"], 6.5);
  EXPECT_EQ(values["isoscope_reload_failures_total file=certificate"], 2);
  EXPECT_EQ(values["isoscope_reload_failures_total file=tokens"], 1);
  EXPECT_EQ(values["isoscope_audit_lines_total result=failed"], 3);
}

TEST(CoordinatorMetricsTest, NamesFollowTheConvention) {
  testing::ExpectNamesFollowTheConvention(CoordinatorMetrics().Collect({}));
}

}  // namespace
}  // namespace isoscope::server
