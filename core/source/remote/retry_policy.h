// When a request is sent again, and after how long.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_RETRY_POLICY_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_RETRY_POLICY_H_

#include <optional>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::source {

struct RetryRules {
  int max_attempts = 6;  // of one range; more survive longer outages, and report them later
  absl::Duration first_delay = absl::Milliseconds(100);  // doubles with each attempt
  absl::Duration max_delay = absl::Seconds(10);
  // A server that asks for a longer wait (Retry-After) is not waited for: UNAVAILABLE says so.
  absl::Duration max_retry_after = absl::Seconds(60);
};

// True for answers that mean that the same request may work later: 408, 429, 500, 502, 503, 504.
bool IsRetryableStatus(int http_status);

// The delay after `failures` >= 1 failed attempts: first_delay * 2^(failures - 1), at most max_delay,
// times a factor in [1/2, 1] by `unit` in [0, 1), so that clients do not come back at once.
absl::Duration RetryDelay(const RetryRules& rules, int failures, double unit);

// The wait that a Retry-After header asks for: "120", or a date, compared with the Date header of the
// same answer, so that no clock of this machine matters. None if it is neither.
std::optional<absl::Duration> ParseRetryAfter(absl::string_view value, absl::string_view date);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_RETRY_POLICY_H_
