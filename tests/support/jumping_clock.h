// A date that jumps in programs that a test starts.
//
//   testing::JumpingClock clock;
//   StartCoordinator(...);
//   clock.SetOffset(-absl::Hours(1));

#ifndef ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_
#define ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_

#include "absl/time/time.h"

#include "tests/support/temp_dir.h"

namespace isoscope::testing {

// Programs that start while it lives have its date: date_functions.cc is preloaded into them. One
// at a time; it sets variables of the environment. Outlives the programs.
class JumpingClock {
 public:
  JumpingClock();
  ~JumpingClock();
  JumpingClock(const JumpingClock&) = delete;
  JumpingClock& operator=(const JumpingClock&) = delete;

  // Sets their date: the machine's and `offset`, in whole seconds.
  void SetOffset(absl::Duration offset);

 private:
  TempDir dir_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_JUMPING_CLOCK_H_
