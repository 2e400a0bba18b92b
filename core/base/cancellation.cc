#include "core/base/cancellation.h"

#include "absl/time/clock.h"

namespace isoscope::base {

absl::Status Cancellation::Check() const {
  if (is_cancelled()) {
    return absl::CancelledError("the frame was cancelled");
  }
  if (deadline_ != absl::InfiniteFuture() && absl::Now() > deadline_) {
    return absl::DeadlineExceededError("the frame's deadline has passed");
  }
  return absl::OkStatus();
}

}  // namespace isoscope::base
