// An arena of as many threads as a test asks for, no matter how many CPUs there are.

#ifndef ISOSCOPE_TESTS_SUPPORT_ONLY_ARENA_H_
#define ISOSCOPE_TESTS_SUPPORT_ONLY_ARENA_H_

#include <memory>

#include "absl/status/statusor.h"

#include "core/base/task_arena.h"

namespace isoscope::testing {

// Makes an arena as programs do (base::TaskArena), and returns it after all of its threads have
// run at one time. DEADLINE_EXCEEDED, with how many did, if they do not come.
//
// REQUIRES: no other arena of this function is alive. Each bounds the threads of the process, and
// TBB takes the least bound.
absl::StatusOr<std::shared_ptr<base::TaskArena>> MakeOnlyArena(int thread_count);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_ONLY_ARENA_H_
