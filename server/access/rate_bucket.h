// A token bucket: a rate that short bursts may exceed.

#ifndef ISOSCOPE_SERVER_ACCESS_RATE_BUCKET_H_
#define ISOSCOPE_SERVER_ACCESS_RATE_BUCKET_H_

#include <algorithm>
#include <cmath>

#include "absl/time/time.h"

#include "core/base/check.h"
#include "core/base/monotonic_time.h"

namespace isoscope::server {

// Begins full. Thread-compatible.
class RateBucket {
 public:
  // rate: units a second; burst: capacity of the bucket. REQUIRES: both are above 0.
  RateBucket(double rate, double burst, base::MonotonicTime now)
      : rate_(rate), burst_(burst), level_(burst), filled_(now) {}

  // Units that are available now. Negative if more was taken than was available.
  double Level(base::MonotonicTime now) {
    if (now > filled_) {
      level_ = std::min(burst_, level_ + rate_ * absl::ToDoubleSeconds(now - filled_));
      filled_ = now;
    }
    return level_;
  }
  // Takes `amount`, even if less is available. A negative amount returns units.
  void Take(double amount) { level_ = std::min(burst_, level_ - amount); }
  // The time from now until the level is `wanted`, in whole milliseconds. REQUIRES: `wanted` is at
  // most the capacity; no level is above it, so the time would never come.
  absl::Duration TimeUntil(double wanted, base::MonotonicTime now) {
    ISOSCOPE_CHECK_LE(wanted, burst_);
    return absl::Milliseconds(std::max(0.0, std::ceil((wanted - Level(now)) / rate_ * 1000)));
  }

 private:
  const double rate_;
  const double burst_;
  double level_;
  base::MonotonicTime filled_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ACCESS_RATE_BUCKET_H_
