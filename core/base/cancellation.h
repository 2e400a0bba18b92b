// Cancellation: a deadline and a flag. Loops poll it, and who waits is woken by it.
//
// A frame makes one Cancellation. What computes polls Check() once per block, page run or draw
// batch, and returns its error at once. What waits, for memory, a disk or another thread, must not
// poll: it waits with AwaitOrCancelled, which Cancel() wakes and which does not sleep past the
// deadline. Something else that has to happen at once is a Cancellation::Callback.
//
// Order of locks. A callback locks the mutex of the one it wakes, and ~Callback waits for a
// callback that is under way. So:
//
// 1. Nobody holds, while constructing or destroying a Callback or calling Cancel(), a mutex that
// the
//    callback locks. In AwaitOrCancelled that is the mutex it is given.
// 2. A callback is short: it sets a flag, signals, closes. It never waits for whoever destroys the
//    Callback, and it runs on the thread that cancels, often one of gRPC's.

#ifndef ISOSCOPE_CORE_BASE_CANCELLATION_H_
#define ISOSCOPE_CORE_BASE_CANCELLATION_H_

#include <atomic>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/any_invocable.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. Outlives its callbacks and calls of Cancel().
class Cancellation {
 public:
  class Callback;

  // Never expires by itself.
  Cancellation() : Cancellation(absl::InfiniteFuture()) {}
  explicit Cancellation(absl::Time deadline) : deadline_(deadline) {}

  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  // Sets the flag, then calls the callbacks, on this thread and one after the other. Only the first
  // call does; another returns at once, perhaps while the callbacks still run.
  void Cancel() ABSL_LOCKS_EXCLUDED(mutex_);

  // That it passes calls nothing back: who waits must not wait longer.
  [[nodiscard]] absl::Time deadline() const { return deadline_; }
  [[nodiscard]] bool is_cancelled() const { return cancelled_.load(std::memory_order_acquire); }

  // OK, or CANCELLED once Cancel() was called, or DEADLINE_EXCEEDED once the deadline has passed.
  // Costs one clock read, and none without a deadline.
  [[nodiscard]] absl::Status Check() const;

 private:
  const absl::Time deadline_;
  std::atomic<bool> cancelled_{false};

  mutable Mutex mutex_;
  mutable CondVar returned_;  // a callback has
  // Those not called yet. Few: one for each thread that waits.
  mutable std::vector<Callback*> callbacks_ ABSL_GUARDED_BY(mutex_);
  const Callback* running_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::thread::id canceller_ ABSL_GUARDED_BY(mutex_);
};

// While it lives, Cancel() calls its function: once, and at once in the constructor if the flag is
// set already. As std::stop_callback. See above for what may be locked.
class Cancellation::Callback {
 public:
  Callback(const Cancellation& cancellation, absl::AnyInvocable<void()> function);
  // Waits until a call under way has returned, unless it is the call itself that destroys this.
  // After it the function is not called and does not run.
  ~Callback();

  Callback(const Callback&) = delete;
  Callback& operator=(const Callback&) = delete;

 private:
  friend class Cancellation;

  const Cancellation& cancellation_;
  absl::AnyInvocable<void()> function_;
};

// Waits until `predicate` returns true: OK; or until `cancellation` fires: its error. The predicate
// is called with `mutex` held, at first and after each signal of `changed`. It is not called again
// once it was true, so it may take what it waited for:
//
//   ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
//       cancellation, &mutex_, &freed_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
//         if (free_bytes_ < bytes) return false;
//         free_bytes_ -= bytes;
//         return true;
//       }));
//
// A predicate that is true wins over a cancellation that has fired. Who changes what it looks at
// signals `changed`; a cancellation signals all. REQUIRES: the calling thread does not hold
// `mutex`.
absl::Status AwaitOrCancelled(const Cancellation& cancellation, Mutex* mutex, CondVar* changed,
                              absl::FunctionRef<bool()> predicate) ABSL_LOCKS_EXCLUDED(mutex);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CANCELLATION_H_
