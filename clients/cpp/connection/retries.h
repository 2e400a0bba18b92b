// Repeats calls that a server refuses with a retry delay (core/base/retry_delay.h), after that
// delay, as often as needed.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"

namespace isoscope::client {

// A call without a deadline is repeated for this long.
inline constexpr absl::Duration kMaxRetryTime = absl::Minutes(5);

// Calls `once` until it is not refused. Stops too if a refusal has no retry delay, or one that ends
// after `deadline` or kMaxRetryTime. Returns the last status. CANCELLED if `interrupt` fires during
// a wait. Thread-safe.
absl::Status CallWithRetries(base::MonotonicTime deadline, const base::Cancellation& interrupt,
                             absl::FunctionRef<absl::Status()> once);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_
