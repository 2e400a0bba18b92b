// The arena in which a program does all its parallel work.

#ifndef ISOSCOPE_CORE_BASE_TASK_ARENA_H_
#define ISOSCOPE_CORE_BASE_TASK_ARENA_H_

#include <memory>

#include <oneapi/tbb/task_arena.h>

namespace isoscope::base {

// Its threads may be more than there are CPUs. With as many threads as CPUs, each slot of the arena
// has a CPU of its own. TBB's workers are bound to theirs. A thread that calls RunIn is moved to
// its slot's CPU, and may leave it again. Without this the kernel may wake several threads on one
// CPU and leave another idle for milliseconds, as was seen in virtual machines. The CPU of a slot
// is random, so that the first slots of many processes do not meet on one CPU.
//
// Thread-safe. No thread is inside when it is destroyed.
class TaskArena {
 public:
  // 0: one thread for each CPU that the process may use
  explicit TaskArena(int thread_count = 0);
  ~TaskArena();
  TaskArena(const TaskArena&) = delete;
  TaskArena& operator=(const TaskArena&) = delete;

  [[nodiscard]] int max_concurrency() const;

  // While this is set, at most max_concurrency() threads compute in RunIn, those in OneThreadScopes
  // included. A thread without such a scope has the whole arena if no other thread computes, else
  // it computes alone. REQUIRES: no thread is inside.
  void SetSharesThreads(bool shares_threads);
  [[nodiscard]] bool shares_threads() const;

 private:
  friend class ArenaEntry;
  struct Parts;
  const std::unique_ptr<Parts> parts_;
};

// While it lives, RunIn on its thread computes on that thread alone. For a thread whose work is one
// of many pieces that run at a time: threads that help each other would only wake each other.
class OneThreadScope {
 public:
  OneThreadScope();
  ~OneThreadScope();
  OneThreadScope(const OneThreadScope&) = delete;
  OneThreadScope& operator=(const OneThreadScope&) = delete;

 private:
  const bool was_inside_another_;
};

// Returns how many threads RunIn(arena, ...) uses here, at most.
int ConcurrencyOf(const TaskArena& arena);

// The entry of a thread into an arena; RunIn makes it. With shared threads it waits until fewer
// than max_concurrency() threads compute.
class ArenaEntry {
 public:
  explicit ArenaEntry(TaskArena* arena);
  ~ArenaEntry();
  ArenaEntry(const ArenaEntry&) = delete;
  ArenaEntry& operator=(const ArenaEntry&) = delete;

  // The arena itself, or one that has only this thread.
  [[nodiscard]] tbb::task_arena& arena() const { return *arena_; }

 private:
  TaskArena::Parts& parts_;
  int permit_count_ = 0;  // that this entry has taken
  tbb::task_arena* arena_ = nullptr;
};

// Runs `function` in the arena, or on this thread alone in a OneThreadScope, and returns what it
// returns. It may call RunIn itself. In a OneThreadScope it takes no slot of the arena: with one,
// frames of 16 agents took a third longer. REQUIRES: `function` waits for no other thread that
// computes in RunIn, and for no disk.
template <typename Function>
auto RunIn(TaskArena* arena, const Function& function) {
  const ArenaEntry entry(arena);
  return entry.arena().execute(function);
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TASK_ARENA_H_
