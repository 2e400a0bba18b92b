#include "core/base/task_arena.h"

#include <sched.h>

#include <barrier>
#include <map>
#include <memory>
#include <set>
#include <thread>

#include <gtest/gtest.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/mutex.h"
#include "tests/support/skips.h"

namespace isoscope::base {
namespace {

std::set<int> CpusOfThisThread() {
  cpu_set_t set;
  CPU_ZERO(&set);
  EXPECT_EQ(sched_getaffinity(0, sizeof(set), &set), 0);
  std::set<int> cpus;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
    if (CPU_ISSET(static_cast<std::size_t>(cpu), &set)) {
      cpus.insert(cpu);
    }
  }
  return cpus;
}

// Returns, by slot of the arena, the CPUs that its thread may use, while all threads are in the
// arena.
std::map<int, std::set<int>> CpusBySlot(tbb::task_arena* arena) {
  std::map<int, std::set<int>> cpus_by_slot;
  Mutex mutex;
  const int count = arena->max_concurrency();
  // No thread leaves before all have arrived, so that each slot is seen once.
  std::barrier all_are_here(count);
  arena->execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<int>(0, count),
        [&](const tbb::blocked_range<int>& /*one*/) {
          {
            const MutexLock lock(&mutex);
            cpus_by_slot[tbb::this_task_arena::current_thread_index()] = CpusOfThisThread();
          }
          all_are_here.arrive_and_wait();
        },
        tbb::simple_partitioner());
  });
  return cpus_by_slot;
}

TEST(TaskArenaTest, HasAThreadForEachCpuUnlessToldOtherwise) {
  EXPECT_EQ(MakeTaskArena()->max_concurrency(), tbb::info::default_concurrency());
  EXPECT_EQ(MakeTaskArena(3)->max_concurrency(), 3);
}

TEST(TaskArenaTest, MoreThreadsThanCpusAllWork) {
  const int count = tbb::info::default_concurrency() + 2;
  EXPECT_EQ(CpusBySlot(MakeTaskArena(count).get()).size(), static_cast<std::size_t>(count));
}

TEST(TaskArenaTest, AsManyThreadsAsCpusHaveACpuEach) {
  const std::set<int> allowed = CpusOfThisThread();
  if (allowed.size() < 2) {
    ISOSCOPE_SKIP("cpus", "one CPU: nothing to share out");
  }
  const std::shared_ptr<tbb::task_arena> arena = MakeTaskArena();
  const std::map<int, std::set<int>> cpus_by_slot = CpusBySlot(arena.get());
  ASSERT_EQ(cpus_by_slot.size(), allowed.size());
  std::set<int> bound;
  int free_threads = 0;
  for (const auto& [slot, cpus] : cpus_by_slot) {
    if (cpus.size() == 1) {
      EXPECT_TRUE(bound.insert(*cpus.begin()).second) << "two workers on CPU " << *cpus.begin();
    } else {
      EXPECT_EQ(cpus, allowed) << "slot " << slot;
      ++free_threads;
    }
  }
  EXPECT_EQ(free_threads, 1) << "the thread that called execute()";
}

TEST(TaskArenaTest, TheCallerMayUseAllCpusAfterwards) {
  const std::set<int> before = CpusOfThisThread();
  const std::shared_ptr<tbb::task_arena> arena = MakeTaskArena();
  for (int i = 0; i < 20; ++i) {
    CpusBySlot(arena.get());
    ASSERT_EQ(CpusOfThisThread(), before);
  }
}

// Returns the threads that take part in a loop that RunIn runs.
std::set<std::thread::id> ThreadsOfRunIn(tbb::task_arena* arena) {
  std::set<std::thread::id> threads;
  Mutex mutex;
  RunIn(arena, [&] {
    tbb::parallel_for(0, 1000, [&](int) {
      const MutexLock lock(&mutex);
      threads.insert(std::this_thread::get_id());
      std::this_thread::yield();
    });
  });
  return threads;
}

TEST(TaskArenaTest, InAOneThreadScopeALoopRunsOnItsThreadAlone) {
  const std::shared_ptr<tbb::task_arena> arena = MakeTaskArena(4);
  EXPECT_EQ(ConcurrencyOf(arena.get()), 4);
  {
    const OneThreadScope alone;
    EXPECT_EQ(ConcurrencyOf(arena.get()), 1);
    for (int i = 0; i < 20; ++i) {
      EXPECT_EQ(ThreadsOfRunIn(arena.get()), std::set{std::this_thread::get_id()});
    }
    EXPECT_EQ(RunIn(arena.get(), [] { return 7; }), 7);
    { const OneThreadScope inner; }
    EXPECT_EQ(ConcurrencyOf(arena.get()), 1) << "the inner scope ended both";
  }
  EXPECT_EQ(ConcurrencyOf(arena.get()), 4);
}

TEST(TaskArenaTest, AOneThreadScopeIsItsThreadsOwn) {
  const std::shared_ptr<tbb::task_arena> arena = MakeTaskArena(2);
  const OneThreadScope alone;
  std::thread([&] { EXPECT_EQ(ConcurrencyOf(arena.get()), 2); }).join();
}

TEST(TaskArenaTest, RunInWithinItselfNeedsNoSecondThread) {
  const std::shared_ptr<tbb::task_arena> arena = MakeTaskArena(1);
  const OneThreadScope alone;
  EXPECT_EQ(RunIn(arena.get(), [&] { return RunIn(arena.get(), [] { return 8; }); }), 8);
}

}  // namespace
}  // namespace isoscope::base
