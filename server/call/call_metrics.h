// Counts the calls of all public services.

#ifndef ISOSCOPE_SERVER_CALL_CALL_METRICS_H_
#define ISOSCOPE_SERVER_CALL_CALL_METRICS_H_

#include <array>
#include <cstddef>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"

namespace isoscope::server {

// Every method of the public services.
enum class RequestMethod {
  kRenderIsosurface,
  kRenderIsosurfaceStream,
  kPickSurface,
  kExportIsosurface,
  kInteract,
  kListDatasets,
  kGetDataset,
  kGetHistogram,
  kGetCapabilities,
  kGetClusterStatus,
};

// "RenderIsosurface".
const char* NameOf(RequestMethod method);

// The reason for ending an export or an interactive stream early.
enum class CutReason { kTooSlow, kTooLong, kMadeRoom, kTokenWithdrawn };
inline constexpr std::size_t kCutReasonCount = 4;

// Thread-safe.
struct CallMetrics {
  CallMetrics();

  void CountRequest(RequestMethod method, const absl::Status& status, absl::Duration duration) {
    requests_.Count(static_cast<std::size_t>(method), status.code(), duration);
  }
  void CountCut(CutReason reason) { cuts_[static_cast<std::size_t>(reason)].Add(); }

  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

  base::Gauge unsent_bytes;  // of answers that wait for their clients

 private:
  base::RequestMetrics requests_;
  std::array<base::Counter, kCutReasonCount> cuts_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CALL_CALL_METRICS_H_
