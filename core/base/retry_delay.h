// The delay after which a refused caller may retry, as a payload of its absl::Status.
// rpc/grpc_status sends it as google.rpc.RetryInfo, which is what clients of gRPC look for.

#ifndef ISOSCOPE_CORE_BASE_RETRY_DELAY_H_
#define ISOSCOPE_CORE_BASE_RETRY_DELAY_H_

#include <optional>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace isoscope::base {

// The longest delay of a refusal. After an hour, somebody should look for the fault.
inline constexpr absl::Duration kMaxRetryDelay = absl::Hours(1);

// Returns `status` with the time to wait, cut to [0, kMaxRetryDelay] and to whole milliseconds,
// upwards. REQUIRES: it is an error.
absl::Status WithRetryDelay(absl::Status status, absl::Duration delay);

// Returns the delay of a refusal; none if it has none. Other errors have none either: only
// RESOURCE_EXHAUSTED and UNAVAILABLE mean that the same call may work later.
std::optional<absl::Duration> RetryDelayOf(const absl::Status& status);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_RETRY_DELAY_H_
