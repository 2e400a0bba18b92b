#include "server/call/call_metrics.h"

#include <vector>

#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

TEST(CallMetricsTest, EveryMethodHasItsName) {
  CallMetrics metrics;
  metrics.CountRequest(RequestMethod::kRenderIsosurface, absl::OkStatus(), absl::Seconds(1));
  metrics.CountRequest(RequestMethod::kGetClusterStatus, absl::OkStatus(), absl::Seconds(1));
  metrics.CountRequest(RequestMethod::kInteract, absl::NotFoundError(""), absl::Seconds(1));
  metrics.CountCut(CutReason::kMadeRoom);
  std::vector<base::MetricFamily> families;
  metrics.AppendMetrics(&families);
  auto values = testing::ValuesOf(families);
  EXPECT_EQ(values["isoscope_requests_total method=RenderIsosurface code=OK"], 1);
  EXPECT_EQ(values["isoscope_requests_total method=GetClusterStatus code=OK"], 1);
  EXPECT_EQ(values["isoscope_requests_total method=Interact code=NOT_FOUND"], 1);
  EXPECT_EQ(values["isoscope_request_duration_seconds method=GetClusterStatus"], 1);
  EXPECT_EQ(values["isoscope_cut_calls_total reason=made_room"], 1);
  EXPECT_EQ(values["isoscope_cut_calls_total reason=too_slow"], 0);
}

}  // namespace
}  // namespace isoscope::server
