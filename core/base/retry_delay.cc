#include "core/base/retry_delay.h"

#include <algorithm>
#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {
namespace {

// The payload is text, so that a status that is printed can be read.
constexpr absl::string_view kPayload = "isoscope.retry_delay";

}  // namespace

absl::Status WithRetryDelay(absl::Status status, absl::Duration delay) {
  const absl::Duration cut =
      absl::Ceil(std::clamp(delay, absl::ZeroDuration(), kMaxRetryDelay), absl::Milliseconds(1));
  status.SetPayload(kPayload, absl::Cord(absl::FormatDuration(cut)));
  return status;
}

std::optional<absl::Duration> RetryDelayOf(const absl::Status& status) {
  if (!absl::IsResourceExhausted(status) && !absl::IsUnavailable(status)) {
    return std::nullopt;
  }
  const auto payload = status.GetPayload(kPayload);
  absl::Duration delay;
  if (!payload.has_value() || !absl::ParseDuration(std::string(*payload), &delay)) {
    return std::nullopt;
  }
  return delay;
}

}  // namespace isoscope::base
