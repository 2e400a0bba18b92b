#include "core/base/mutex.h"

#include <algorithm>

#include "absl/time/clock.h"

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

bool CondVar::WaitUntil(Mutex* mutex, absl::Time deadline) ABSL_NO_THREAD_SAFETY_ANALYSIS {
  if (deadline == absl::InfiniteFuture()) {
    Wait(mutex);
    return true;
  }
  const absl::Time now = absl::Now();
  if (now >= deadline) {
    return false;
  }
  std::unique_lock<std::mutex> lock(mutex->mutex_, std::adopt_lock);
  // The system's clock counts, as for absl::Time.
  condition_.wait_until(lock, absl::ToChronoTime(std::min(deadline, now + kMaxWait)));
  lock.release();
  return absl::Now() < deadline;
}

}  // namespace isoscope::base
