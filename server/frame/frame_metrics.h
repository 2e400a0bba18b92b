// Counts frames and picks: their ends, waits and steps (frame_ticket).

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_METRICS_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_METRICS_H_

#include <cstddef>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"
#include "server/frame/render_statistics.h"

namespace isoscope::server {

// Thread-safe.
struct FrameMetrics {
  // The most callers that have a series of their own.
  static constexpr std::size_t kMaxCallers = 32;

  // Counts a frame or a pick that ended after it had waited for a thread. `is_moving`: a frame of
  // an interactive stream in motion. `caller`: name of the token; "" without one.
  void CountEnd(const absl::Status& status, absl::Duration duration, bool is_moving,
                absl::string_view caller);
  // Counts a frame that got no place, in its caller's series only.
  void CountRefused(absl::string_view caller);
  // Counts the steps of a frame that ended well.
  void CountSteps(const FrameCost& cost);

  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

  base::Counter done;
  base::Counter failed;     // except cancelled ones
  base::Counter cancelled;  // by the client, or because a newer view replaced it
  base::Counter refused;    // too many were in work or waiting, or others had priority
  base::Counter displaced;  // evicted while waiting; among the refused ones
  base::Counter expired;    // the deadline passed in the queue; among the failed ones
  base::Counter rate_limited;
  base::Counter too_large;  // above the memory limit
  base::Counter partial;
  base::Counter network_bytes;
  base::Counter response_bytes;
  base::DurationHistogram queue_wait;
  base::DurationHistogram memory_wait;

 private:
  enum CallerOutcome : std::size_t { kDone, kFailed, kCancelled, kRefused };

  base::DurationHistogram exact_;  // whole frames, with picks
  base::DurationHistogram moving_;
  base::DurationHistogram occluder_selection_;
  base::DurationHistogram occluder_rendering_;
  base::DurationHistogram visibility_culling_;
  base::DurationHistogram composite_;
  base::DurationHistogram encode_;
  base::CountersByName callers_{"caller", {"done", "failed", "cancelled", "refused"}, kMaxCallers};
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_METRICS_H_
