// Skips a test if this machine lacks something, and counts the skip, so that it is not mistaken for
// success. tests/support/skips.py is the same for Python and shells.
//
//   ISOSCOPE_REQUIRE  reasons, separated by commas: such a skip is a failure ("all": each one)
//   ISOSCOPE_SKIPS    a file that gets a line "reason<TAB>message" for each skip
//
// CONTRIBUTING.md lists the reasons. What never runs here by design is left out of the test, by a
// condition of the compiler or of the instantiation, and not skipped.

#ifndef ISOSCOPE_TESTS_SUPPORT_SKIPS_H_
#define ISOSCOPE_TESTS_SUPPORT_SKIPS_H_

#include <string>

#include "absl/strings/string_view.h"
#include "gtest/gtest.h"

namespace isoscope::testing {

// Whether a skip for this reason is a failure. `required` is the value of ISOSCOPE_REQUIRE, or
// null.
bool IsRequired(absl::string_view reason, const char* required);

// Notes a skip in the file of ISOSCOPE_SKIPS, if there is one. Returns whether it is a failure.
bool NoteSkip(absl::string_view reason, absl::string_view message);

}  // namespace isoscope::testing

// Ends the test as skipped, or as failed where ISOSCOPE_REQUIRE names the reason. For the body of a
// test or SetUp.
#define ISOSCOPE_SKIP(reason, message)                                                        \
  do {                                                                                        \
    const std::string isoscope_skip_message(message);                                         \
    if (::isoscope::testing::NoteSkip(reason, isoscope_skip_message)) {                       \
      GTEST_FAIL() << "ISOSCOPE_REQUIRE names " << (reason) << ": " << isoscope_skip_message; \
    }                                                                                         \
    GTEST_SKIP() << (reason) << ": " << isoscope_skip_message;                                \
  } while (false)

#endif  // ISOSCOPE_TESTS_SUPPORT_SKIPS_H_
