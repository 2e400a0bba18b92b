// Makes the arena in which a program does all its parallel work.

#ifndef ISOSCOPE_CORE_BASE_TASK_ARENA_H_
#define ISOSCOPE_CORE_BASE_TASK_ARENA_H_

#include <memory>

#include "absl/cleanup/cleanup.h"
#include <oneapi/tbb/task_arena.h>

namespace isoscope::base {

// Makes an arena of `thread_count` threads, which may be more than there are CPUs. 0 means one for
// each CPU that the process may use. With as many threads as CPUs, each slot of the arena has a CPU
// of its own. TBB's workers are bound to theirs. A thread that calls execute() is moved to its
// slot's CPU, and may leave it again. Without this the kernel may wake several threads on one CPU
// and leave another idle for milliseconds, as was seen in virtual machines. The CPU of a slot is
// random, so that the first slots of many processes do not meet on one CPU.
std::shared_ptr<tbb::task_arena> MakeTaskArena(int thread_count = 0);

// While it lives, RunIn on its thread computes on one thread. For a thread whose work is one of
// many pieces that run at a time: threads that help each other would only wake each other.
class OneThreadScope {
 public:
  OneThreadScope();
  ~OneThreadScope();
  OneThreadScope(const OneThreadScope&) = delete;
  OneThreadScope& operator=(const OneThreadScope&) = delete;

 private:
  tbb::task_arena* const before_;  // of an outer scope
};

// Returns how many threads RunIn(arena, ...) uses here, at most.
int ConcurrencyOf(const tbb::task_arena& arena);

namespace internal {

// The scope of this thread: an arena of one thread, null if there is none; and whether this thread
// computes in it.
struct OneThread {
  tbb::task_arena* arena = nullptr;
  bool is_inside = false;
};
OneThread& OneThreadOfThisThread();

}  // namespace internal

// Runs `function` in `arena`, and returns what it returns. In a OneThreadScope it takes one slot of
// `arena`, so that this bounds all threads that compute, and its loops find no other thread.
template <typename Function>
auto RunIn(tbb::task_arena* arena, const Function& function) {
  const internal::OneThread scope = internal::OneThreadOfThisThread();
  if (scope.arena == nullptr) {
    return arena->execute(function);
  }
  if (scope.is_inside) {  // it has its slot, and must not wait for a second one
    return function();
  }
  // Where all slots are taken, another thread of the arena may run it.
  return arena->execute([&function, alone = scope.arena] {
    return alone->execute([&function, alone] {
      internal::OneThread& here = internal::OneThreadOfThisThread();
      const absl::Cleanup restore = [&here, before = here] { here = before; };
      here = {.arena = alone, .is_inside = true};
      return function();
    });
  });
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TASK_ARENA_H_
