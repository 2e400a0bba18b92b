// Moments of the clock that nobody sets. Intervals, deadlines and waits use it, because the date of
// a machine can jump by hours.
//
//   const base::MonotonicTime deadline = base::MonotonicNow() + absl::Seconds(2);
//   changed_.AwaitUntil(&mutex_, deadline, ...);
//
// absl::Time is a date. It does not convert to a MonotonicTime, so mixing them does not compile.
// tools/check_clocks.py lists the sources that may read the date: logs, times of files and
// certificates.

#ifndef ISOSCOPE_CORE_BASE_MONOTONIC_TIME_H_
#define ISOSCOPE_CORE_BASE_MONOTONIC_TIME_H_

#include <chrono>
#include <compare>

#include "absl/time/time.h"

namespace isoscope::base {

// A moment of std::chrono::steady_clock (CLOCK_MONOTONIC). It has a meaning in its own process
// only. The time that a machine sleeps does not count. A value type.
class MonotonicTime {
 public:
  // The clock's zero, which lies before this process.
  constexpr MonotonicTime() = default;

  static constexpr MonotonicTime InfinitePast() { return MonotonicTime(-absl::InfiniteDuration()); }
  static constexpr MonotonicTime InfiniteFuture() {
    return MonotonicTime(absl::InfiniteDuration());
  }
  // REQUIRES: the moment is finite, and at most 290 years from the clock's zero.
  [[nodiscard]] std::chrono::steady_clock::time_point ToChrono() const {
    return std::chrono::steady_clock::time_point(absl::ToChronoNanoseconds(since_zero_));
  }

  MonotonicTime& operator+=(absl::Duration duration) {
    since_zero_ += duration;
    return *this;
  }
  MonotonicTime& operator-=(absl::Duration duration) {
    since_zero_ -= duration;
    return *this;
  }
  friend MonotonicTime operator+(MonotonicTime time, absl::Duration duration) {
    return time += duration;
  }
  friend MonotonicTime operator+(absl::Duration duration, MonotonicTime time) {
    return time += duration;
  }
  friend MonotonicTime operator-(MonotonicTime time, absl::Duration duration) {
    return time -= duration;
  }
  // Infinite if one of the two is.
  friend absl::Duration operator-(MonotonicTime end, MonotonicTime begin) {
    return end.since_zero_ - begin.since_zero_;
  }
  friend constexpr bool operator==(MonotonicTime a, MonotonicTime b) {
    return a.since_zero_ == b.since_zero_;
  }
  friend constexpr std::strong_ordering operator<=>(MonotonicTime a, MonotonicTime b) {
    return a.since_zero_ < b.since_zero_   ? std::strong_ordering::less
           : a.since_zero_ > b.since_zero_ ? std::strong_ordering::greater
                                           : std::strong_ordering::equal;
  }

 private:
  friend MonotonicTime MonotonicNow();
  constexpr explicit MonotonicTime(absl::Duration since_zero) : since_zero_(since_zero) {}

  absl::Duration since_zero_ = absl::ZeroDuration();
};

inline MonotonicTime MonotonicNow() {
  return MonotonicTime(absl::FromChrono(std::chrono::steady_clock::now().time_since_epoch()));
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MONOTONIC_TIME_H_
