// A date that jumps in programs that a test starts.
//
//   testing::JumpingClock clock;
//   Process::Start(argv, {.environment = clock.environment()});
//   clock.SetOffset(-absl::Hours(1));

#ifndef ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_
#define ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_

#include <string>
#include <vector>

#include "absl/time/time.h"

#include "tests/support/temp_dir.h"

namespace isoscope::testing {

// Thread-compatible. Lives as long as the programs.
class JumpingClock {
 public:
  JumpingClock() { SetOffset(absl::ZeroDuration()); }

  // "NAME=VALUE": preloads date_functions.cc into a program.
  [[nodiscard]] std::vector<std::string> environment() const;
  // Sets the date of all programs that have the environment: the machine's and `offset`.
  void SetOffset(absl::Duration offset);

 private:
  TempDir dir_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_
