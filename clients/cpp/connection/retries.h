// Calls that a server refuses and that say when to come again (core/base/retry_delay.h): made again
// at that time, as often as it takes.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_

#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"

namespace isoscope::client {

// A call without a deadline is made again for so long.
inline constexpr absl::Duration kMaxRetryTime = absl::Minutes(5);

// Calls `once` until it is not refused, or its refusal tells no time, or one that is not before
// `deadline` or within kMaxRetryTime; returns its last status. CANCELLED if `interrupt` fires while
// it waits. Thread-safe.
absl::Status CallWithRetries(absl::Time deadline, const base::Cancellation& interrupt,
                             absl::FunctionRef<absl::Status()> once);

// What all calls of this process have met since its begin.
struct RetryCounts {
  std::int64_t refusals = 0;
  std::int64_t retries = 0;  // refusals that were followed by another try
};
RetryCounts CountRetries();

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_RETRIES_H_
