// Cancellation: a deadline and a flag that long loops poll.
//
// A frame makes one Cancellation; whatever works on the frame polls Check() once per block, page
// run or draw batch, and returns its error at once.

#ifndef ISOSCOPE_CORE_BASE_CANCELLATION_H_
#define ISOSCOPE_CORE_BASE_CANCELLATION_H_

#include <atomic>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace isoscope::base {

// Thread-safe.
class Cancellation {
 public:
  // Never expires by itself.
  Cancellation() : Cancellation(absl::InfiniteFuture()) {}
  explicit Cancellation(absl::Time deadline) : deadline_(deadline) {}

  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  void Cancel() { cancelled_.store(true, std::memory_order_release); }

  [[nodiscard]] absl::Time deadline() const { return deadline_; }
  [[nodiscard]] bool is_cancelled() const { return cancelled_.load(std::memory_order_acquire); }

  // OK, or CANCELLED once Cancel() was called, or DEADLINE_EXCEEDED once the deadline has passed.
  // Costs one clock read.
  [[nodiscard]] absl::Status Check() const;

 private:
  const absl::Time deadline_;
  std::atomic<bool> cancelled_{false};
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CANCELLATION_H_
