// Makes the arena in which a program does all its parallel work.

#ifndef ISOSCOPE_CORE_BASE_TASK_ARENA_H_
#define ISOSCOPE_CORE_BASE_TASK_ARENA_H_

#include <memory>

#include <oneapi/tbb/task_arena.h>

namespace isoscope::base {

// Makes an arena of `thread_count` threads, which may be more than there are CPUs. 0 means one for
// each CPU that the process may use. With as many threads as CPUs, each slot of the arena has a CPU
// of its own. TBB's workers are bound to theirs. A thread that calls execute() is moved to its
// slot's CPU, and may leave it again. Without this the kernel may wake several threads on one CPU
// and leave another idle for milliseconds, as was seen in virtual machines. The CPU of a slot is
// random, so that the first slots of many processes do not meet on one CPU.
std::shared_ptr<tbb::task_arena> MakeTaskArena(int thread_count = 0);

// While it lives, RunIn on its thread computes on that thread alone. For a thread whose work is one
// of many pieces that run at a time: threads that help each other would only wake each other.
class OneThreadScope {
 public:
  OneThreadScope();
  ~OneThreadScope();
  OneThreadScope(const OneThreadScope&) = delete;
  OneThreadScope& operator=(const OneThreadScope&) = delete;

 private:
  tbb::task_arena* const before_;  // of an outer scope
};

// The arena of this thread's OneThreadScope; `arena` where there is none.
tbb::task_arena& ArenaOfThisThread(tbb::task_arena* arena);

// Returns how many threads RunIn(arena, ...) uses here, at most.
inline int ConcurrencyOf(tbb::task_arena* arena) {
  return ArenaOfThisThread(arena).max_concurrency();
}

// Runs `function` in ArenaOfThisThread(arena), and returns what it returns. In a OneThreadScope it
// takes no slot of `arena`: with one, frames of 16 agents took a third longer.
template <typename Function>
auto RunIn(tbb::task_arena* arena, const Function& function) {
  return ArenaOfThisThread(arena).execute(function);
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TASK_ARENA_H_
