#include "core/base/cancellation.h"

#include <algorithm>
#include <utility>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"

namespace isoscope::base {

void Cancellation::Cancel() {
  MutexLock lock(&mutex_);
  if (cancelled_.exchange(true, std::memory_order_acq_rel)) {
    return;
  }
  canceller_ = std::this_thread::get_id();
  while (!callbacks_.empty()) {
    Callback* const callback = callbacks_.back();
    callbacks_.pop_back();
    running_ = callback;
    mutex_.Unlock();
    callback->function_();  // which may destroy *callback
    mutex_.Lock();
    running_ = nullptr;
    returned_.SignalAll();
  }
}

absl::Status Cancellation::Check() const {
  if (is_cancelled()) {
    return absl::CancelledError("the operation was cancelled");
  }
  if (deadline_ != MonotonicTime::InfiniteFuture() && MonotonicNow() > deadline_) {
    return absl::DeadlineExceededError("the deadline of the operation has passed");
  }
  return absl::OkStatus();
}

Cancellation::Callback::Callback(const Cancellation& cancellation,
                                 absl::AnyInvocable<void()> function)
    : cancellation_(cancellation), function_(std::move(function)) {
  {
    // Cancel() sets the flag under the lock. So it either finds this callback, or has set the flag.
    MutexLock lock(&cancellation_.mutex_);
    if (!cancellation_.is_cancelled()) {
      cancellation_.callbacks_.push_back(this);
      return;
    }
  }
  function_();
}

Cancellation::Callback::~Callback() {
  MutexLock lock(&cancellation_.mutex_);
  auto& callbacks = cancellation_.callbacks_;
  const auto found = std::find(callbacks.begin(), callbacks.end(), this);
  if (found != callbacks.end()) {
    callbacks.erase(found);
    return;
  }
  if (cancellation_.canceller_ == std::this_thread::get_id()) {
    return;
  }
  cancellation_.returned_.Await(&cancellation_.mutex_,
                                [this]() ABSL_SHARED_LOCKS_REQUIRED(cancellation_.mutex_) {
                                  return cancellation_.running_ != this;
                                });
}

absl::Status AwaitOrCancelled(const Cancellation& cancellation, Mutex* mutex, CondVar* changed,
                              absl::FunctionRef<bool()> predicate) {
  {
    MutexLock lock(mutex);
    if (predicate()) {
      return absl::OkStatus();
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  // The callback signals under the lock, because a thread that has just seen the flag unset may not
  // wait yet.
  const Cancellation::Callback wake(cancellation, [mutex, changed] {
    MutexLock lock(mutex);
    changed->SignalAll();
  });
  MutexLock lock(mutex);
  while (!predicate()) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    changed->WaitUntil(mutex, cancellation.deadline());
  }
  return absl::OkStatus();
}

}  // namespace isoscope::base
