// A thread's semaphore in abseil is one word, the count of posts, on which the thread waits in the
// kernel (futex). Its own wait gives the kernel a date. Here a wait with an end does this, until it
// has a post or the end has passed:
//
// 1. It asks the semaphore for a post, with an end that has passed, so that abseil does not wait.
// 2. It waits on the word itself, while that is 0, with an end on the monotonic clock.
//
// A post in between changes the word, and the kernel does not wait then.

#include "core/base/absl_waits.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <ctime>

#include "absl/base/config.h"
#include "absl/base/internal/thread_identity.h"
#include "absl/synchronization/internal/create_thread_identity.h"
#include "absl/synchronization/internal/futex.h"
#include "absl/synchronization/internal/kernel_timeout.h"
#include "absl/synchronization/internal/per_thread_sem.h"
#include "absl/synchronization/internal/waiter.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <linux/futex.h>

#include "core/base/monotonic_time.h"

namespace isoscope::base {
namespace {

namespace absl_internal = absl::synchronization_internal;
using Word = std::atomic<std::int32_t>;

static_assert(ABSL_WAITER_MODE == ABSL_WAITER_MODE_FUTEX &&
                  sizeof(absl_internal::Waiter) == sizeof(Word),
              "abseil's semaphore is not the one word that this source waits on");

// An end too far away for the kernel is no end.
constexpr absl::Duration kMaxAbslWait = absl::Hours(24 * 365);

thread_local bool was_called = false;

// The time until a date. For seconds after the date was set, absl::Now may have the old one. The end
// may come from absl::Now or, as those of gRPC, from the system: the one of its own clock is nearer.
absl::Duration TimeUntil(absl::Time end) {
  timespec date{};
  clock_gettime(CLOCK_REALTIME, &date);
  const absl::Duration by_system = end - absl::TimeFromTimespec(date);
  const absl::Duration by_abseil = end - absl::Now();
  return absl::AbsDuration(by_system) < absl::AbsDuration(by_abseil) ? by_system : by_abseil;
}

bool WaitForPost(absl_internal::KernelTimeout timeout) {
  was_called = true;
  absl_internal::Waiter* const waiter =
      absl_internal::Waiter::GetWaiter(absl_internal::GetOrCreateCurrentThreadIdentity());
  if (!timeout.has_timeout()) {
    return waiter->Wait(timeout);
  }
  const absl::Duration wait = TimeUntil(absl::TimeFromTimespec(timeout.MakeAbsTimespec()));
  const MonotonicTime end = MonotonicNow() + std::min(wait, kMaxAbslWait);
  const timespec kernel_end = absl::ToTimespec(absl::FromChrono(end.ToChrono().time_since_epoch()));
  const absl_internal::KernelTimeout passed(absl::UnixEpoch());
  while (!waiter->Wait(passed)) {
    if (MonotonicNow() >= end) {
      return false;
    }
    absl_internal::Futex::WaitBitsetAbsoluteTimeout(
        reinterpret_cast<Word*>(waiter), 0, static_cast<std::int32_t>(FUTEX_BITSET_MATCH_ANY),
        &kernel_end);
  }
  return true;
}

}  // namespace

bool AreAbslWaitsMonotonic() {
  was_called = false;
  absl::Mutex mutex;
  absl::CondVar never;
  const absl::MutexLock lock(&mutex);
  never.WaitWithTimeout(&mutex, absl::Nanoseconds(1));
  return was_called;
}

}  // namespace isoscope::base

// abseil calls it by this name.
extern "C" bool ABSL_INTERNAL_C_SYMBOL(AbslInternalPerThreadSemWait)(
    absl::synchronization_internal::KernelTimeout timeout) {
  return isoscope::base::WaitForPost(timeout);
}
