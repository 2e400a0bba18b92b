#include "core/base/mutex.h"

#include <algorithm>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::base {
namespace {

// A wait for a deadline that is farther away than this goes in parts, so that neither a library nor
// the kernel computes with large times.
constexpr absl::Duration kMaxWait = absl::Hours(24);

}  // namespace

// The analysis does not see that the functions below release and take the mutex.
void CondVar::Wait(Mutex* mutex) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  std::unique_lock<std::mutex> lock(mutex->mutex_, std::adopt_lock);
  condition_.wait(lock);
  lock.release();
}

bool CondVar::WaitUntil(Mutex* mutex, MonotonicTime deadline) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  if (deadline == MonotonicTime::InfiniteFuture()) {
    Wait(mutex);
    return true;
  }
  const MonotonicTime now = MonotonicNow();
  if (now >= deadline) {
    return false;
  }
  std::unique_lock<std::mutex> lock(mutex->mutex_, std::adopt_lock);
  condition_.wait_until(lock, std::min(deadline, now + kMaxWait).ToChrono());
  lock.release();
  return MonotonicNow() < deadline;
}

}  // namespace isoscope::base
