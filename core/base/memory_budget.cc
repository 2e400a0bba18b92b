#include "core/base/memory_budget.h"

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"

namespace isoscope::base {

absl::StatusOr<MemoryBudget::Reservation> MemoryBudget::Reserve(std::size_t bytes,
                                                                const Cancellation& cancellation) {
  if (bytes > capacity_bytes_) {
    return absl::ResourceExhaustedError(absl::StrCat(bytes, " bytes are needed and at most ",
                                                     capacity_bytes_, " may be used for it"));
  }
  // A cancelled caller gets nothing, even where there is room.
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  if (bytes == 0) {
    return Reservation(this, 0);  // nothing is always free
  }
  Waiter waiter;
  waiter.bytes = bytes;
  std::list<Waiter*> place{&waiter};
  {
    const MutexLock lock(&mutex_);
    waiter.since = now_();
    waiters_.splice(waiters_.end(), place);
    ServeWaiters();
  }
  absl::Cleanup leave = [this, &waiter] { Leave(&waiter); };
  ISOSCOPE_RETURN_IF_ERROR(AwaitOrCancelled(
      cancellation, &mutex_, &waiter.served,
      [&waiter]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return waiter.is_served; }));
  std::move(leave).Cancel();
  return Reservation(this, bytes);
}

void MemoryBudget::Release(std::size_t bytes) {
  const MutexLock lock(&mutex_);
  free_bytes_ += bytes;
  ServeWaiters();
}

void MemoryBudget::ServeWaiters() {
  for (auto at = waiters_.begin(); at != waiters_.end();) {
    Waiter& waiter = **at;
    if (waiter.bytes > free_bytes_) {
      if (at == waiters_.begin() && now_() - waiter.since >= kMaxOvertakenDuration) {
        return;
      }
      ++at;
      continue;
    }
    free_bytes_ -= waiter.bytes;
    at = waiters_.erase(at);
    waiter.is_served = true;
    waiter.served.Signal();
  }
}

void MemoryBudget::Leave(Waiter* waiter) {
  const MutexLock lock(&mutex_);
  if (waiter->is_served) {
    free_bytes_ += waiter->bytes;
  } else {
    waiters_.remove(waiter);
  }
  ServeWaiters();  // those behind it
}

}  // namespace isoscope::base
