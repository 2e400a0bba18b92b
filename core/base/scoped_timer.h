// Measures the wall time of a scope.

#ifndef ISOSCOPE_CORE_BASE_SCOPED_TIMER_H_
#define ISOSCOPE_CORE_BASE_SCOPED_TIMER_H_

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::base {

// Adds the wall time of its own life to `sum`, which outlives it. Thread-compatible.
class ScopedTimer {
 public:
  explicit ScopedTimer(absl::Duration* sum) : sum_(sum), start_(MonotonicNow()) {}
  ~ScopedTimer() { *sum_ += MonotonicNow() - start_; }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  absl::Duration* const sum_;
  const MonotonicTime start_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_SCOPED_TIMER_H_
