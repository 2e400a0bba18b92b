#include "core/base/clock_alignment.h"

#include <algorithm>

namespace isoscope::base {

void ClockAlignment::AddSent(absl::Duration our_send, absl::Duration peer_receive) {
  const absl::Duration bound = our_send - peer_receive;
  lower_ = std::max(lower_.value_or(bound), bound);
}

void ClockAlignment::AddReceived(absl::Duration peer_send, absl::Duration our_receive) {
  const absl::Duration bound = our_receive - peer_send;
  upper_ = std::min(upper_.value_or(bound), bound);
}

absl::Duration ClockAlignment::offset() const {
  if (!lower_.has_value() || !upper_.has_value()) {
    return lower_.value_or(upper_.value_or(absl::ZeroDuration()));
  }
  return *lower_ + (*upper_ - *lower_) / 2;
}

absl::Duration ClockAlignment::error() const {
  if (!lower_.has_value() || !upper_.has_value()) {
    return absl::InfiniteDuration();
  }
  return absl::AbsDuration(*upper_ - *lower_) / 2;
}

}  // namespace isoscope::base
