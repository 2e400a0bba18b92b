#include "core/base/mutex.h"

#include <algorithm>

#include "absl/time/clock.h"

namespace isoscope::base {
namespace {

// A deadline that is farther away than this is waited for in parts, so that no library and no
// kernel has to do sums with it.
constexpr absl::Duration kMaxWait = absl::Hours(24);

}  // namespace

// Neither function locks or unlocks as the analysis sees it.
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
  // By the system's clock, as absl::Time counts.
  condition_.wait_until(lock, absl::ToChronoTime(std::min(deadline, now + kMaxWait)));
  lock.release();
  return absl::Now() < deadline;
}

}  // namespace isoscope::base
