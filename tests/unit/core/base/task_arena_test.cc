#include "core/base/task_arena.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <barrier>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <thread>
#include <vector>

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
std::map<int, std::set<int>> CpusBySlot(TaskArena* arena) {
  std::map<int, std::set<int>> cpus_by_slot;
  Mutex mutex;
  const int count = arena->max_concurrency();
  // No thread leaves before all have arrived, so that each slot is seen once.
  std::barrier all_are_here(count);
  RunIn(arena, [&] {
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
  EXPECT_EQ(std::make_shared<TaskArena>()->max_concurrency(), tbb::info::default_concurrency());
  EXPECT_EQ(std::make_shared<TaskArena>(3)->max_concurrency(), 3);
}

TEST(TaskArenaTest, MoreThreadsThanCpusAllWork) {
  const int count = tbb::info::default_concurrency() + 2;
  EXPECT_EQ(CpusBySlot(std::make_shared<TaskArena>(count).get()).size(),
            static_cast<std::size_t>(count));
}

TEST(TaskArenaTest, AsManyThreadsAsCpusHaveACpuEach) {
  const std::set<int> allowed = CpusOfThisThread();
  if (allowed.size() < 2) {
    ISOSCOPE_SKIP("cpus", "one CPU: nothing to share out");
  }
  const std::shared_ptr<TaskArena> arena = std::make_shared<TaskArena>();
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
  const std::shared_ptr<TaskArena> arena = std::make_shared<TaskArena>();
  for (int i = 0; i < 20; ++i) {
    CpusBySlot(arena.get());
    ASSERT_EQ(CpusOfThisThread(), before);
  }
}

// Returns the threads that take part in a loop that RunIn runs.
std::set<std::thread::id> ThreadsOfRunIn(TaskArena* arena) {
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
  const std::shared_ptr<TaskArena> arena = std::make_shared<TaskArena>(4);
  EXPECT_EQ(ConcurrencyOf(*arena), 4);
  {
    const OneThreadScope alone;
    EXPECT_EQ(ConcurrencyOf(*arena), 1);
    for (int i = 0; i < 20; ++i) {
      EXPECT_EQ(ThreadsOfRunIn(arena.get()), std::set{std::this_thread::get_id()});
    }
    EXPECT_EQ(RunIn(arena.get(), [] { return 7; }), 7);
    { const OneThreadScope inner; }
    EXPECT_EQ(ConcurrencyOf(*arena), 1) << "the inner scope ended both";
  }
  EXPECT_EQ(ConcurrencyOf(*arena), 4);
}

TEST(TaskArenaTest, AOneThreadScopeIsItsThreadsOwn) {
  const std::shared_ptr<TaskArena> arena = std::make_shared<TaskArena>(2);
  const OneThreadScope alone;
  std::thread([&] { EXPECT_EQ(ConcurrencyOf(*arena), 2); }).join();
}

TEST(TaskArenaTest, RunInWithinItselfNeedsNoSecondThread) {
  const std::shared_ptr<TaskArena> arena = std::make_shared<TaskArena>(1);
  const OneThreadScope alone;
  EXPECT_EQ(RunIn(arena.get(), [&] { return RunIn(arena.get(), [] { return 8; }); }), 8);
}

// Counts the threads inside at a time, and the most there were.
class Presence {
 public:
  void Work() {
    const int now = inside_.fetch_add(1) + 1;
    int most = most_.load();
    while (now > most && !most_.compare_exchange_weak(most, now)) {
    }
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    inside_.fetch_sub(1);
  }
  [[nodiscard]] int most() const { return most_.load(); }

 private:
  std::atomic<int> inside_ = 0;
  std::atomic<int> most_ = 0;
};

TEST(TaskArenaTest, SharedThreadsAreNeverMoreThanTheArenas) {
  for (const int width : {1, 2, 3, 8}) {
    SCOPED_TRACE(width);
    TaskArena arena(width);
    arena.SetSharesThreads(true);
    Presence presence;
    std::vector<std::thread> callers;
    for (int i = 0; i < 12; ++i) {
      callers.emplace_back([&, i] {
        for (int round = 0; round < 30; ++round) {
          std::optional<OneThreadScope> alone;
          if ((i + round) % 3 > 0) {
            alone.emplace();
          }
          RunIn(&arena, [&] { tbb::parallel_for(0, 4, [&](int) { presence.Work(); }); });
        }
      });
    }
    for (std::thread& caller : callers) {
      caller.join();
    }
    EXPECT_LE(presence.most(), width);
    EXPECT_GE(presence.most(), std::min(width, 2)) << "threads wait for each other";
  }
}

TEST(TaskArenaTest, ACallerHasAllSharedThreadsWhenNobodyElseComputes) {
  TaskArena arena(4);
  arena.SetSharesThreads(true);
  Mutex mutex;
  CondVar changed;
  int here = 0;
  for (int round = 0; round < 3; ++round) {
    here = 0;
    RunIn(&arena, [&] {
      tbb::parallel_for(
          tbb::blocked_range<int>(0, 4),
          [&](const tbb::blocked_range<int>& /*one*/) {
            MutexLock lock(&mutex);
            if (++here == 4) {
              changed.SignalAll();
            }
            changed.Await(&mutex, [&] { return here == 4; });
          },
          tbb::simple_partitioner());
    });
  }
  EXPECT_EQ(here, 4);
}

TEST(TaskArenaTest, ATaskOfASharedArenaMayCallRunIn) {
  TaskArena arena(4);
  arena.SetSharesThreads(true);
  std::atomic<int> sum = 0;
  for (int round = 0; round < 20; ++round) {
    RunIn(&arena, [&] {
      tbb::parallel_for(0, 100, [&](int) {
        RunIn(&arena, [&] { tbb::parallel_for(0, 3, [&](int) { sum.fetch_add(1); }); });
      });
    });
  }
  EXPECT_EQ(sum.load(), 6000);
}

TEST(TaskArenaTest, ACallerThatAlwaysComesBackLeavesOthersTheirTurn) {
  TaskArena arena(1);
  arena.SetSharesThreads(true);
  std::atomic<bool> has_run = false;
  std::thread other([&] { RunIn(&arena, [&] { has_run = true; }); });
  while (!has_run) {
    RunIn(&arena, [] { std::this_thread::sleep_for(std::chrono::milliseconds(1)); });
  }
  other.join();
}

}  // namespace
}  // namespace isoscope::base
