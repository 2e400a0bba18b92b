// A number of bytes that concurrent work shares. Work that needs more than is left waits.
//
// Waiters are served in the order in which they came. One that fits may overtake those before it,
// so that free memory is used, until the first has waited for kMaxOvertakenDuration. Then no waiter
// overtakes it, so that small work can't starve large work.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_
#define ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_

#include <cstddef>
#include <functional>
#include <list>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. Outlives its reservations.
class MemoryBudget {
 public:
  // Returns the time. Called with the budget's mutex held.
  using Clock = std::function<MonotonicTime()>;

  // Long enough to use free memory, since most steps end sooner; short enough for users.
  static constexpr absl::Duration kMaxOvertakenDuration = absl::Milliseconds(100);

  explicit MemoryBudget(std::size_t capacity_bytes, Clock now = MonotonicNow)
      : capacity_bytes_(capacity_bytes), now_(std::move(now)), free_bytes_(capacity_bytes) {}
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // Bytes that were taken. The destructor gives them back.
  class Reservation {
   public:
    Reservation(Reservation&& other) noexcept
        : budget_(std::exchange(other.budget_, nullptr)), bytes_(other.bytes_) {}
    Reservation& operator=(Reservation&&) = delete;
    ~Reservation() {
      if (budget_ != nullptr) {
        budget_->Release(bytes_);
      }
    }

    // Gives back all but `bytes`; does nothing if there are fewer.
    void ShrinkTo(std::size_t bytes) {
      if (budget_ != nullptr && bytes < bytes_) {
        budget_->Release(std::exchange(bytes_, bytes) - bytes);
      }
    }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }

   private:
    friend class MemoryBudget;
    Reservation(MemoryBudget* budget, std::size_t bytes) : budget_(budget), bytes_(bytes) {}

    MemoryBudget* budget_;
    std::size_t bytes_;
  };

  // Waits until `bytes` are free and it is the caller's turn. RESOURCE_EXHAUSTED, at once, if the
  // budget is smaller than that; the error of `cancellation` if it fires first. REQUIRES: the
  // caller holds no reservation of this budget that it gives back only afterwards. Waiters before
  // it in the queue may need those bytes.
  absl::StatusOr<Reservation> Reserve(std::size_t bytes, const Cancellation& cancellation);

  [[nodiscard]] std::size_t capacity_bytes() const { return capacity_bytes_; }
  // Returns the bytes of all reservations.
  [[nodiscard]] std::size_t reserved_bytes() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(&mutex_);
    return capacity_bytes_ - free_bytes_;
  }
  // Returns the number of calls of Reserve that wait.
  [[nodiscard]] std::size_t waiting_count() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(&mutex_);
    return waiters_.size();
  }

 private:
  // A call of Reserve, on its stack.
  struct Waiter {
    std::size_t bytes = 0;
    MonotonicTime since;
    bool is_served = false;  // it has the bytes, and has left the queue
    CondVar served;
  };

  void Release(std::size_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  // Gives bytes to those whose turn it is.
  void ServeWaiters() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Takes a waiter out that was not served, or gives back the bytes that it doesn't want.
  void Leave(Waiter* waiter) ABSL_LOCKS_EXCLUDED(mutex_);

  const std::size_t capacity_bytes_;
  const Clock now_;
  mutable Mutex mutex_;
  std::size_t free_bytes_ ABSL_GUARDED_BY(mutex_);
  std::list<Waiter*> waiters_ ABSL_GUARDED_BY(mutex_);  // in order of arrival
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_
