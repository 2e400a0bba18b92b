#include "server/frame/frame_metrics.h"

#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

std::map<std::string, double> ValuesOf(const FrameMetrics& metrics) {
  std::vector<base::MetricFamily> families;
  metrics.AppendMetrics(&families);
  return testing::ValuesOf(families);
}

TEST(FrameMetricsTest, FramesAreCountedByOutcomeAndCancelledOnesHaveNoDuration) {
  FrameMetrics metrics;
  metrics.CountEnd(absl::OkStatus(), absl::Seconds(1), false, "a");
  metrics.CountEnd(absl::UnavailableError(""), absl::Seconds(1), false, "a");
  metrics.CountEnd(absl::CancelledError(""), absl::Seconds(1), false, "a");
  metrics.CountEnd(absl::OkStatus(), absl::Milliseconds(20), true, "");
  metrics.CountRefused("a");
  metrics.refused.Add();
  auto values = ValuesOf(metrics);
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

TEST(FrameMetricsTest, FramesThatWereNotDrawnAreCountedByReason) {
  FrameMetrics metrics;
  metrics.refused.Add(5);
  metrics.displaced.Add(2);
  metrics.expired.Add();
  metrics.too_large.Add(7);
  auto values = ValuesOf(metrics);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=queue_full"], 3);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=made_room"], 2);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=deadline"], 1);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=token_rate"], 0);
  EXPECT_EQ(values["isoscope_admission_refused_frames_total reason=memory_limit"], 7);
}

}  // namespace
}  // namespace isoscope::server
