// The first step of every program.

#ifndef ISOSCOPE_CORE_BASE_PROCESS_SETUP_H_
#define ISOSCOPE_CORE_BASE_PROCESS_SETUP_H_

namespace isoscope::base {

// Sets what libraries decide once for the whole process: the count of malloc's arenas, whether
// abseil looks for deadlocks, the clock of its waits (absl_waits.h), and that OpenSSL stays until
// the process is gone. Call it first in main(), before threads start.
void SetUpProcess();

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_PROCESS_SETUP_H_
