#include "web-gateway/gateway_metrics.h"

#include <map>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace isoscope::gateway {
namespace {

TEST(GatewayMetricsTest, RequestsAreCountedByStatusAndGaugesAreThoseThatWereGiven) {
  GatewayMetrics metrics;
  metrics.CountRequest(200, absl::Milliseconds(3));
  metrics.CountRequest(304, absl::Milliseconds(3));
  metrics.CountRequest(304, absl::Milliseconds(3));
  metrics.CountRequest(-7, absl::Milliseconds(3));  // never happens, and breaks nothing
  metrics.CountRequest(70'000, absl::Milliseconds(3));
  metrics.viewers.store(2);
  std::map<std::string, double> values;
  for (const base::MetricFamily& family : metrics.Collect({.connections = 9,
                                          .max_connections = 256,
                                          .dropped_connections = 5,
                                          .pictures = 1,
                                          .certificate_days_left = 6.5,
                                          .certificate_failures = 2})) {
    EXPECT_TRUE(absl::EndsWith(family.help, ".")) << family.name;
    EXPECT_EQ(absl::EndsWith(family.name, "_total"),
              family.type == base::MetricFamily::Type::kCounter)
        << family.name;
    for (const base::MetricSample& sample : family.samples) {
      values[absl::StrCat(
          family.name, sample.labels.empty() ? "" : " " + sample.labels[0].second)] = sample.value;
    }
  }
  EXPECT_EQ(values["isoscope_http_requests_total 200"], 1);
  EXPECT_EQ(values["isoscope_http_requests_total 304"], 2);
  EXPECT_EQ(values["isoscope_http_connections"], 9);
  EXPECT_EQ(values["isoscope_http_dropped_connections_total"], 5);
  EXPECT_EQ(values["isoscope_viewers"], 2);
  EXPECT_EQ(values["isoscope_certificate_days_left"], 6.5);
  EXPECT_EQ(values["isoscope_reload_failures_total certificate"], 2);
}

}  // namespace
}  // namespace isoscope::gateway
