// A date that jumps in a test that links test_date_functions. CLOCK_MONOTONIC goes on as it is.

#ifndef ISOSCOPE_TESTS_SUPPORT_DATE_FUNCTIONS_H_
#define ISOSCOPE_TESTS_SUPPORT_DATE_FUNCTIONS_H_

#include <cstdint>

namespace isoscope::testing {

// Sets the date of this process to the machine's and `offset_seconds`. Waits under way heed it, as
// they do when somebody sets the clock of a machine.
void SetDateOffset(std::int64_t offset_seconds);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_DATE_FUNCTIONS_H_
