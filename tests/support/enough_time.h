// Limits of time that a part of a test has to keep, though a machine under load may be slow.

#ifndef ISOSCOPE_TESTS_SUPPORT_ENOUGH_TIME_H_
#define ISOSCOPE_TESTS_SUPPORT_ENOUGH_TIME_H_

#include "absl/time/time.h"
#include "gtest/gtest.h"

namespace isoscope::testing {

// Calls attempt(limit) until it returns true: what had to come within the limit did. Each attempt has
// four times the limit of the one before. One that was too slow returns false, and expects nothing.
template <typename Attempt>
void WithEnoughTime(absl::Duration limit, const Attempt& attempt) {
  constexpr int kMostAttempts = 5;
  for (int i = 0; i < kMostAttempts; ++i) {
    if (attempt(limit)) {
      return;
    }
    limit *= 4;
  }
  ADD_FAILURE() << "never in time, at last within " << limit / 4;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_ENOUGH_TIME_H_
