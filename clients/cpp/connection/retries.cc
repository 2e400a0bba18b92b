#include "clients/cpp/connection/retries.h"

#include <algorithm>
#include <optional>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

// Returns CANCELLED if it is interrupted.
absl::Status Sleep(absl::Duration duration, const base::Cancellation& interrupt) {
  base::Mutex mutex;
  base::CondVar interrupted;
  const base::Cancellation::Callback on_interrupt(interrupt, [&] {
    const base::MutexLock lock(&mutex);
    interrupted.SignalAll();
  });
  base::MutexLock lock(&mutex);
  const bool is_interrupted = interrupted.AwaitUntil(&mutex, base::MonotonicNow() + duration,
                                                     [&] { return interrupt.is_cancelled(); });
  return is_interrupted ? absl::CancelledError("interrupted") : absl::OkStatus();
}

}  // namespace

absl::Status CallWithRetries(base::MonotonicTime deadline, const base::Cancellation& interrupt,
                             absl::FunctionRef<absl::Status()> once) {
  const base::MonotonicTime last_try = std::min(deadline, base::MonotonicNow() + kMaxRetryTime);
  while (true) {
    absl::Status status = once();
    const std::optional<absl::Duration> delay = base::RetryDelayOf(status);
    if (!delay.has_value()) {
      return status;
    }
    if (base::MonotonicNow() + *delay >= last_try) {
      return status;
    }
    ISOSCOPE_RETURN_IF_ERROR(Sleep(*delay, interrupt));
  }
}

}  // namespace isoscope::client
