// The arena in which a program does all its parallel work.

#ifndef ISOSCOPE_CORE_BASE_TASK_ARENA_H_
#define ISOSCOPE_CORE_BASE_TASK_ARENA_H_

#include <memory>

#include <oneapi/tbb/task_arena.h>

namespace isoscope::base {

// An arena of `thread_count` threads, more than there are CPUs if asked for; 0: one for each CPU
// that the process may use. With just as many threads as CPUs, each place of the arena has a CPU of
// its own: TBB's workers are bound to theirs, a thread that calls execute() is moved to its place's
// CPU and free to leave it again. Kernels wake both on the same CPU else and leave another idle for
// milliseconds, as was seen in virtual machines. Which place has which CPU is random, so that the
// first places of many processes do not meet on one CPU.
std::shared_ptr<tbb::task_arena> MakeTaskArena(int thread_count = 0);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TASK_ARENA_H_
