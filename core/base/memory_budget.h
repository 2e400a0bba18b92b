// A number of bytes that concurrent work shares. Work that needs more than is left waits.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_
#define ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_

#include <cstddef>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. Outlives its reservations.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::size_t capacity_bytes)
      : capacity_bytes_(capacity_bytes), free_bytes_(capacity_bytes) {}
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

  // Waits until `bytes` are free. RESOURCE_EXHAUSTED, at once, if the budget is smaller than that;
  // the error of `cancellation` if it fires first.
  absl::StatusOr<Reservation> Reserve(std::size_t bytes, const Cancellation& cancellation);

  [[nodiscard]] std::size_t capacity_bytes() const { return capacity_bytes_; }
  // Returns the bytes of all reservations.
  [[nodiscard]] std::size_t reserved_bytes() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(&mutex_);
    return capacity_bytes_ - free_bytes_;
  }

 private:
  void Release(std::size_t bytes);

  const std::size_t capacity_bytes_;
  mutable Mutex mutex_;
  CondVar freed_;
  std::size_t free_bytes_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_BUDGET_H_
