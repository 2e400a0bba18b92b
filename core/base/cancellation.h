// Cancellation: a deadline and a flag. Loops poll it, and waiting threads are woken by it.
//
// A frame makes one Cancellation. Code that computes polls Check() once per block, disk run or draw
// batch, and returns its error at once. Code that waits for memory, a disk or another thread must
// not poll. It waits with AwaitOrCancelled, which Cancel() wakes and which does not sleep past the
// deadline. A Cancellation::Callback does anything else that must happen at once.
//
// Order of locks. A callback locks the mutex of the thread that it wakes, and ~Callback waits for a
// callback that is under way. So:
//
// 1. A thread that constructs or destroys a Callback, or calls Cancel(), holds no mutex that the
//    callback locks. AwaitOrCancelled has a Callback that locks the mutex given to it.
//
// 2. A callback is short: it sets a flag, signals, closes. It never waits for the thread that
//    destroys the Callback, and it runs on the thread that cancels, often one of gRPC's.

#ifndef ISOSCOPE_CORE_BASE_CANCELLATION_H_
#define ISOSCOPE_CORE_BASE_CANCELLATION_H_

#include <atomic>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/any_invocable.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. Outlives its callbacks and calls of Cancel().
class Cancellation {
 public:
  class Callback;

  // Makes one that never expires by itself.
  Cancellation() : Cancellation(MonotonicTime::InfiniteFuture()) {}
  explicit Cancellation(MonotonicTime deadline) : deadline_(deadline) {}

  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  // Sets the flag, then calls the callbacks on this thread, one after the other. A second call does
  // nothing and returns at once, perhaps while the callbacks still run.
  void Cancel() ABSL_LOCKS_EXCLUDED(mutex_);

  // No callback runs when it passes: a thread that waits must stop by itself.
  [[nodiscard]] MonotonicTime deadline() const { return deadline_; }
  [[nodiscard]] bool is_cancelled() const { return cancelled_.load(std::memory_order_acquire); }

  // Returns CANCELLED once Cancel() was called, DEADLINE_EXCEEDED once the deadline has passed,
  // else OK. Reads the clock once, or not at all without a deadline.
  [[nodiscard]] absl::Status Check() const;

 private:
  const MonotonicTime deadline_;
  std::atomic<bool> cancelled_{false};

  mutable Mutex mutex_;
  mutable CondVar returned_;  // a callback has returned
  // The callbacks that were not called yet. There are few: one for each waiting thread.
  mutable std::vector<Callback*> callbacks_ ABSL_GUARDED_BY(mutex_);
  const Callback* running_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::thread::id canceller_ ABSL_GUARDED_BY(mutex_);
};

// While it lives, Cancel() calls its function, once. The constructor calls it if the flag is
// already set. Works as std::stop_callback does. The rules about locks stand above.
class Cancellation::Callback {
 public:
  Callback(const Cancellation& cancellation, absl::AnyInvocable<void()> function);
  // Waits until a call under way has returned, unless that call destroys this object. Afterwards
  // the function does not run and is not called.
  ~Callback();

  Callback(const Callback&) = delete;
  Callback& operator=(const Callback&) = delete;

 private:
  friend class Cancellation;

  const Cancellation& cancellation_;
  absl::AnyInvocable<void()> function_;
};

// Waits until `predicate` returns true, or until `cancellation` fires: then returns its error.
// Calls the predicate with `mutex` held, at first and after each signal of `changed`, until it is
// true. So the predicate may take the thing that it waits for:
//
//   ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
//       cancellation, &mutex_, &freed_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
//         if (free_bytes_ < bytes) return false;
//         free_bytes_ -= bytes;
//         return true;
//       }));
//
// A predicate that is true wins over a cancellation that has fired. Code that can make it true must
// signal `changed`; a cancellation signals all. REQUIRES: the calling thread does not hold
// `mutex`.
absl::Status AwaitOrCancelled(const Cancellation& cancellation, Mutex* mutex, CondVar* changed,
                              absl::FunctionRef<bool()> predicate) ABSL_LOCKS_EXCLUDED(mutex);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CANCELLATION_H_
