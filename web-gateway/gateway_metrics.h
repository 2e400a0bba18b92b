// All metrics of a gateway. docs/operations.md lists them in a table; a test compares it with the
// output of Collect.

#ifndef ISOSCOPE_WEB_GATEWAY_GATEWAY_METRICS_H_
#define ISOSCOPE_WEB_GATEWAY_GATEWAY_METRICS_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/time/time.h"

#include "core/base/metrics.h"

namespace isoscope::gateway {

// Present values that other objects keep.
struct GatewayGauges {
  int connections = 0;
  int max_connections = 0;
  std::int64_t dropped_connections = 0;  // that waited, for others
  int pictures = 0;
  int max_pictures = 0;
  double certificate_days_left = 0;  // of the certificate for browsers
  std::int64_t certificate_failures = 0;
};

// Updated while the gateway works, by atomics alone. Thread-safe.
struct GatewayMetrics {
  // status: HTTP status code.
  void CountRequest(int status, absl::Duration duration);

  std::atomic<int> viewers{0};    // open WebSockets
  base::Counter refused;          // connections and requests that found no place
  base::Counter sent_frames;      // to viewers
  base::Counter replaced_frames;  // by newer ones, because the viewer was slow

  // Returns the values above and `gauges`, with the metrics of the process.
  [[nodiscard]] std::vector<base::MetricFamily> Collect(const GatewayGauges& gauges) const;

 private:
  static constexpr int kLeastStatus = 100;
  static constexpr std::size_t kStatusCount = 500;

  std::array<base::Counter, kStatusCount> by_status_;
  base::DurationHistogram duration_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_GATEWAY_METRICS_H_
