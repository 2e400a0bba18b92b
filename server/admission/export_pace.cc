#include "server/admission/export_pace.h"

#include <algorithm>

#include "core/base/monotonic_time.h"

namespace isoscope::server {

void ExportPace::OnWriteDone(std::size_t bytes, base::MonotonicTime now) {
  if (!write_begin_.has_value()) {
    return;
  }
  const absl::Duration earned = absl::Seconds(static_cast<double>(bytes) /
                                              static_cast<double>(limits_.least_bytes_per_second));
  left_ = std::min(limits_.allowance, left_ - (now - *write_begin_) + earned);
  write_begin_.reset();
}

ExportPace::Verdict ExportPace::Judge(base::MonotonicTime now) const {
  if (now >= begin_ + limits_.max_duration) {
    return Verdict::kTooLong;
  }
  return write_begin_.has_value() && now >= SlowTime(now) ? Verdict::kTooSlow : Verdict::kGoesOn;
}

base::MonotonicTime ExportPace::NextJudgement(base::MonotonicTime now) const {
  // A finished write that took more than was left leaves a debt. Then the next write exceeds the
  // allowance at once.
  constexpr absl::Duration kLeast = absl::Milliseconds(10);
  return std::min(begin_ + limits_.max_duration, std::max(SlowTime(now), now + kLeast));
}

}  // namespace isoscope::server
