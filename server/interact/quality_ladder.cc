#include "server/interact/quality_ladder.h"

#include <algorithm>

namespace isoscope::server {
namespace {

constexpr int kOverloadsToCoarsen = 3;
constexpr double kRoomToRefine = 0.9;

}  // namespace

void QualityLadder::OnLoad(double load, double finer_load, base::MonotonicTime now) {
  if (load > 1) {
    ++overload_count_;
    const bool is_due = overload_count_ >= kOverloadsToCoarsen || load > kSevereLoad;
    // After a step, frames of the previous setting are still on their way.
    if (!is_due || step_ + 1 >= step_count_ || now - last_change_ < absl::Milliseconds(250)) {
      return;
    }
    if (is_starting_) {
      is_starting_ = false;
      hold_ = kMinHold;
    } else if (last_was_finer_ && now - last_change_ < hold_) {
      hold_ = std::min(hold_ * 2, kMaxHold);
    }
    ++step_;
    last_was_finer_ = false;
  } else {
    overload_count_ = 0;
    if (step_ == 0 || finer_load > kRoomToRefine || now - last_change_ < hold_) {
      return;
    }
    --step_;
    last_was_finer_ = true;
  }
  overload_count_ = 0;
  last_change_ = now;
}

}  // namespace isoscope::server
