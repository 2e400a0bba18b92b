// The behaviour of TBB that our code relies on, and that tests/support/tsan_tbb must have as well.
// The release build runs this with TBB, the tsan preset with the stand-in.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/parallel_pipeline.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>
#include <oneapi/tbb/task_scheduler_observer.h>

namespace isoscope {
namespace {

using ::testing::Each;

// No test takes that long unless it fails.
constexpr std::chrono::seconds kLongest(10);
// Enough for a task to begin that must not begin.
constexpr std::chrono::milliseconds kMoment(100);

// Waits until `is_set`, at most for `longest`. Orders nothing, so that races stay visible.
void Await(const std::atomic<bool>& is_set, std::chrono::milliseconds longest = kLongest) {
  const auto end = std::chrono::steady_clock::now() + longest;
  while (!is_set.load(std::memory_order_relaxed) && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
}
void Set(std::atomic<bool>* flag) { flag->store(true, std::memory_order_relaxed); }

// Threads that a set of tasks ran on.
class ThreadsSeen {
 public:
  void Add() {
    const std::lock_guard<std::mutex> lock(mutex_);
    threads_.insert(std::this_thread::get_id());
  }
  [[nodiscard]] std::size_t count() const { return threads_.size(); }

 private:
  std::mutex mutex_;
  std::set<std::thread::id> threads_;
};

class TbbContractTest : public ::testing::Test {
 private:
  // TBB makes more threads than there are CPUs only if this allows them.
  const tbb::global_control allow_{tbb::global_control::max_allowed_parallelism, 4};
};

TEST_F(TbbContractTest, ALoopCallsEachIndexOnce) {
  for (const int count : {0, 1, 2, 3, 7, 1000}) {
    std::vector<int> calls(static_cast<std::size_t>(count));
    tbb::parallel_for(0, count, [&](int i) { ++calls[static_cast<std::size_t>(i)]; });
    EXPECT_THAT(calls, Each(1)) << count;
  }
  tbb::parallel_for(5, 3, [](int /*i*/) { ADD_FAILURE() << "an empty range"; });
}

TEST_F(TbbContractTest, PiecesOfARangeAreDisjointAndComplete) {
  std::vector<int> calls(1000);
  std::atomic<std::size_t> longest{0};
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, calls.size(), 16),
      [&](const tbb::blocked_range<std::size_t>& piece) {
        for (std::size_t i = piece.begin(); i < piece.end(); ++i) {
          ++calls[i];
        }
        std::size_t before = longest;
        while (before < piece.size() && !longest.compare_exchange_weak(before, piece.size())) {
        }
      },
      tbb::simple_partitioner());
  EXPECT_THAT(calls, Each(1));
  EXPECT_LE(longest, 16U);
}

TEST_F(TbbContractTest, AsManyThreadsAsTheArenaHasWorkAtOnce) {
  tbb::task_arena arena(3);
  EXPECT_EQ(arena.max_concurrency(), 3);
  std::set<int> slots;
  std::mutex mutex;
  arena.execute([&] {
    EXPECT_EQ(tbb::this_task_arena::max_concurrency(), 3);
    std::atomic<int> arrived{0};
    tbb::parallel_for(
        tbb::blocked_range<int>(0, 3),
        [&](const tbb::blocked_range<int>& /*one*/) {
          ++arrived;
          while (arrived < 3) {
            std::this_thread::yield();
          }
          const std::lock_guard<std::mutex> lock(mutex);
          slots.insert(tbb::this_task_arena::current_thread_index());
        },
        tbb::simple_partitioner());
  });
  EXPECT_EQ(slots, (std::set<int>{0, 1, 2}));
}

TEST_F(TbbContractTest, AnArenaOfOneThreadWorksOnTheCallers) {
  tbb::task_arena alone(1);
  ThreadsSeen threads;
  const std::thread::id caller = alone.execute([&] {
    tbb::parallel_for(0, 100, [&](int /*i*/) { threads.Add(); });
    return std::this_thread::get_id();
  });
  EXPECT_EQ(caller, std::this_thread::get_id());
  EXPECT_EQ(threads.count(), 1U);
}

TEST_F(TbbContractTest, LoopsInsideLoopsAreComplete) {
  tbb::task_arena arena(3);
  std::atomic<int> calls{0};
  arena.execute([&] {
    tbb::parallel_for(
        0, 20, [&](int /*outer*/) { tbb::parallel_for(0, 20, [&](int /*inner*/) { ++calls; }); });
  });
  EXPECT_EQ(calls, 400);
}

TEST_F(TbbContractTest, SeveralCallersShareAnArena) {
  tbb::task_arena arena(2);
  std::atomic<int> calls{0};
  std::vector<std::thread> callers;
  for (int caller = 0; caller < 4; ++caller) {
    callers.emplace_back([&] {
      for (int repetition = 0; repetition < 20; ++repetition) {
        arena.execute([&] { tbb::parallel_for(0, 50, [&](int /*i*/) { ++calls; }); });
      }
    });
  }
  for (std::thread& caller : callers) {
    caller.join();
  }
  EXPECT_EQ(calls, 4 * 20 * 50);
}

TEST_F(TbbContractTest, ExceptionsReachTheCaller) {
  const auto fail = [](int i) {
    if (i == 17) {
      throw std::runtime_error("17");
    }
  };
  EXPECT_THROW(tbb::parallel_for(0, 100, fail), std::runtime_error);
  tbb::task_group group;
  group.run([&] { fail(17); });
  EXPECT_THROW(group.wait(), std::runtime_error);
  group.run([&] { fail(16); });
  group.wait();
}

TEST_F(TbbContractTest, ACancelledLoopStops) {
  tbb::task_group_context context(tbb::task_group_context::isolated);
  std::atomic<int> calls{0};
  tbb::parallel_for(
      0, 100'000,
      [&](int /*i*/) {
        ++calls;
        context.cancel_group_execution();
      },
      tbb::simple_partitioner(), context);
  EXPECT_LT(calls, 100'000);
}

TEST_F(TbbContractTest, AGroupIsDoneAfterWaitAndCanRunAgain) {
  tbb::task_arena arena(3);
  tbb::task_group group;
  for (int repetition = 0; repetition < 10; ++repetition) {
    std::vector<int> done(20);
    for (int& one : done) {
      arena.execute([&] {
        group.run([&one, owned = std::string("moved")] {
          tbb::parallel_for(0, 1, [&](int /*i*/) { one = static_cast<int>(owned.size()); });
        });
      });
    }
    arena.execute([&] { group.wait(); });
    EXPECT_THAT(done, Each(5));
  }
}

TEST_F(TbbContractTest, AllThatIsInvokedIsDone) {
  int first = 0;
  int second = 0;
  tbb::parallel_invoke([&] { first = 1; }, [&] { second = 2; });
  EXPECT_EQ(first, 1);
  EXPECT_EQ(second, 2);
}

TEST_F(TbbContractTest, EachThreadHasItsElement) {
  tbb::task_arena arena(3);
  tbb::enumerable_thread_specific<std::vector<int>> elements(std::size_t{1}, 7);
  ThreadsSeen threads;
  arena.execute([&] {
    tbb::parallel_for(0, 1000, [&](int i) {
      threads.Add();
      elements.local().push_back(i);
    });
  });
  EXPECT_EQ(elements.size(), threads.count());
  std::vector<int> all;
  std::atomic<std::size_t> in_range{0};
  tbb::parallel_for(elements.range(1), [&](const auto& range) {
    for (std::vector<int>& element : range) {
      in_range += element.size();
    }
  });
  for (const std::vector<int>& element : std::as_const(elements)) {
    EXPECT_EQ(element.front(), 7);
    all.insert(all.end(), element.begin() + 1, element.end());
  }
  EXPECT_EQ(in_range, 1000 + threads.count());
  std::sort(all.begin(), all.end());
  ASSERT_EQ(all.size(), 1000U);
  for (int i = 0; i < 1000; ++i) {
    EXPECT_EQ(all[static_cast<std::size_t>(i)], i);
  }
}

TEST_F(TbbContractTest, ElementsAreMadeByTheFunctionAndNewForEachObject) {
  for (int object = 0; object < 3; ++object) {
    tbb::enumerable_thread_specific<int> elements{[object] { return object; }};
    EXPECT_EQ(elements.local(), object);
    elements.local() = 9;
    EXPECT_EQ(elements.local(), 9);
    EXPECT_EQ(elements.size(), 1U);
    elements.clear();
    EXPECT_EQ(elements.size(), 0U);
    EXPECT_EQ(elements.local(), object) << "made anew";
  }
}

TEST_F(TbbContractTest, APipelineKeepsTheOrderAndReusesTokens) {
  constexpr std::size_t kTokens = 3;
  std::vector<int> buffers(kTokens);
  int next = 0;
  std::vector<int> written;
  tbb::parallel_pipeline(
      kTokens,
      tbb::make_filter<void, int*>(tbb::filter_mode::serial_in_order,
                                   [&](tbb::flow_control& control) -> int* {
                                     if (next == 500) {
                                       control.stop();
                                       return nullptr;
                                     }
                                     int* const buffer =
                                         &buffers[static_cast<std::size_t>(next) % kTokens];
                                     *buffer = next++;
                                     return buffer;
                                   }) &
          tbb::make_filter<int*, int*>(tbb::filter_mode::parallel,
                                       [](int* buffer) {
                                         *buffer *= 2;
                                         return buffer;
                                       }) &
          tbb::make_filter<int*, void>(tbb::filter_mode::serial_in_order,
                                       [&](const int* buffer) { written.push_back(*buffer); }));
  ASSERT_EQ(written.size(), 500U);
  for (int i = 0; i < 500; ++i) {
    EXPECT_EQ(written[static_cast<std::size_t>(i)], 2 * i);
  }
}

TEST_F(TbbContractTest, AFailedPipelineThrows) {
  int next = 0;
  EXPECT_THROW(
      tbb::parallel_pipeline(
          2, tbb::make_filter<void, int>(tbb::filter_mode::serial_in_order,
                                         [&](tbb::flow_control& /*control*/) { return next++; }) &
                 tbb::make_filter<int, int>(tbb::filter_mode::parallel,
                                            [](int i) {
                                              if (i == 20) {
                                                throw std::runtime_error("20");
                                              }
                                              return i;
                                            }) &
                 tbb::make_filter<int, void>(tbb::filter_mode::serial_in_order, [](int /*i*/) {})),
      std::runtime_error);
}

class CountingObserver final : public tbb::task_scheduler_observer {
 public:
  explicit CountingObserver(tbb::task_arena* arena) : tbb::task_scheduler_observer(*arena) {
    observe(true);
  }
  void on_scheduler_entry(bool is_worker) override { entries_ += is_worker ? 0 : 1; }
  void on_scheduler_exit(bool is_worker) override { exits_ += is_worker ? 0 : 1; }

  [[nodiscard]] int entries() const { return entries_; }
  [[nodiscard]] int exits() const { return exits_; }

 private:
  std::atomic<int> entries_{0};
  std::atomic<int> exits_{0};
};

TEST_F(TbbContractTest, ObserversSeeTheCallerComeAndGo) {
  tbb::task_arena arena(1);
  arena.initialize();
  CountingObserver observer(&arena);
  arena.execute([&] {
    EXPECT_EQ(observer.entries(), 1);
    EXPECT_EQ(observer.exits(), 0);
  });
  EXPECT_EQ(observer.exits(), 1);
  observer.observe(false);
}

// How a thread waits.
enum class Wait { kForLoop, kForGroup };

// Calls both functions at once, one on the calling thread and one on another. Waits for them.
void InTwoThreads(Wait wait, const std::function<void()>& here,
                  const std::function<void()>& elsewhere) {
  const std::thread::id caller = std::this_thread::get_id();
  std::atomic<bool> is_here{false};
  std::atomic<bool> is_elsewhere{false};
  const auto work = [&] {
    if (std::this_thread::get_id() == caller) {
      Set(&is_here);
      Await(is_elsewhere);
      here();
    } else {
      Set(&is_elsewhere);
      Await(is_here);
      elsewhere();
    }
  };
  if (wait == Wait::kForLoop) {
    tbb::parallel_for(
        0, 2, [&](int /*i*/) { work(); }, tbb::simple_partitioner());
  } else {
    tbb::task_group group;
    group.run(work);
    work();
    group.wait();
  }
  EXPECT_TRUE(is_elsewhere) << "no other thread came";
}

// A task begins while its thread waits inside of another one, for something else.
class TbbWaitTest : public TbbContractTest, public ::testing::WithParamInterface<Wait> {};

INSTANTIATE_TEST_SUITE_P(All, TbbWaitTest, ::testing::Values(Wait::kForLoop, Wait::kForGroup),
                         [](const ::testing::TestParamInfo<Wait>& wait) {
                           return wait.param == Wait::kForLoop ? "Loop" : "Group";
                         });

// A thread that waits while it holds a lock, or uses its element, meets both again in a task of the
// outer work.
TEST_P(TbbWaitTest, TheWaitingThreadTakesAnOuterTaskInTheMiddleOfAnother) {
  tbb::task_arena arena(2);
  tbb::enumerable_thread_specific<int> depths;
  int seen_depth = 0;
  std::atomic<bool> is_taken{false};
  arena.execute([&] {
    tbb::task_group outer;
    outer.run([&] {
      ++depths.local();
      InTwoThreads(
          GetParam(),
          [&] {
            outer.run([&] {
              seen_depth = depths.local();
              Set(&is_taken);
            });
          },
          [&] { Await(is_taken); });
      --depths.local();
    });
    outer.wait();
  });
  EXPECT_EQ(seen_depth, 1);
}

TEST_P(TbbWaitTest, TheWaitingThreadTakesChunksOfAnotherCallersLoop) {
  tbb::task_arena arena(3);
  const std::thread::id waiting = std::this_thread::get_id();
  std::atomic<bool> is_inside{false};
  std::atomic<bool> is_other_begun{false};
  std::atomic<bool> is_taken{false};
  std::atomic<int> calls{0};
  std::thread other([&] {
    Await(is_inside);
    arena.execute([&] {
      tbb::parallel_for(
          0, 8,
          [&](int /*i*/) {
            ++calls;
            Set(&is_other_begun);
            if (std::this_thread::get_id() == waiting) {
              Set(&is_taken);
            } else {
              Await(is_taken);
            }
          },
          tbb::simple_partitioner());
    });
  });
  arena.execute([&] {
    InTwoThreads(
        GetParam(),
        [&] {
          Set(&is_inside);
          Await(is_other_begun);
        },
        [&] { Await(is_taken); });
  });
  other.join();
  EXPECT_TRUE(is_taken);
  EXPECT_EQ(calls, 8);
}

TEST_P(TbbWaitTest, AThreadInAnIsolatedRegionTakesTasksOfThatRegion) {
  tbb::task_arena arena(2);
  std::thread::id waiting;
  std::thread::id taking;
  std::atomic<bool> is_taken{false};
  arena.execute([&] {
    tbb::task_group outer;
    tbb::this_task_arena::isolate([&] {
      InTwoThreads(
          GetParam(),
          [&] {
            waiting = std::this_thread::get_id();
            outer.run([&] {
              taking = std::this_thread::get_id();
              Set(&is_taken);
            });
          },
          [&] { Await(is_taken); });
    });
    outer.wait();
  });
  EXPECT_EQ(taking, waiting);
}

TEST_P(TbbWaitTest, ATakenTaskFailsForThoseThatWaitForIt) {
  tbb::task_arena arena(2);
  std::atomic<bool> is_taken{false};
  std::atomic<bool> is_inner_whole{false};
  arena.execute([&] {
    tbb::task_group outer;
    outer.run([&] {
      InTwoThreads(
          GetParam(),
          [&] {
            outer.run([&] {
              Set(&is_taken);
              throw std::runtime_error("taken");
            });
          },
          [&] { Await(is_taken); });
      is_inner_whole = true;
    });
    EXPECT_THROW(outer.wait(), std::runtime_error);
  });
  EXPECT_TRUE(is_inner_whole);
}

// Keeps the arena's other thread busy, starts a task, and calls wait(arena, busy), which waits for
// the busy thread or for something else. Returns whether the task was done in `wait`. The thread
// is busy until the task is begun, at most for `longest`.
bool IsTakenIn(std::chrono::milliseconds longest,
               const std::function<void(tbb::task_arena*, tbb::task_group*)>& wait) {
  tbb::task_arena arena(2);
  const std::thread::id waiting = std::this_thread::get_id();
  bool is_waiting = false;  // of the calling thread only
  bool is_taken_in_wait = false;
  std::atomic<bool> is_busy{false};
  std::atomic<bool> is_taken{false};
  arena.execute([&] {
    tbb::task_group busy;
    tbb::task_group outer;
    busy.run([&] {
      Set(&is_busy);
      Await(is_taken, longest);
    });
    Await(is_busy);
    outer.run([&] {
      is_taken_in_wait = std::this_thread::get_id() == waiting && is_waiting;
      Set(&is_taken);
    });
    is_waiting = true;
    wait(&arena, &busy);
    is_waiting = false;
    outer.wait();
    busy.wait();
  });
  return is_taken_in_wait;
}

TEST_F(TbbContractTest, AThreadInAnIsolatedRegionTakesNoTasksFromOutside) {
  EXPECT_TRUE(
      IsTakenIn(kLongest, [](tbb::task_arena* /*arena*/, tbb::task_group* busy) { busy->wait(); }));
  EXPECT_FALSE(IsTakenIn(kMoment, [](tbb::task_arena* /*arena*/, tbb::task_group* busy) {
    tbb::this_task_arena::isolate([&] { busy->wait(); });
  }));
}

TEST_F(TbbContractTest, AThreadThatWaitsInAnotherArenaTakesNoTasksOfTheFirst) {
  tbb::task_arena another(2);
  EXPECT_FALSE(IsTakenIn(2 * kMoment, [&](tbb::task_arena* /*arena*/, tbb::task_group* /*busy*/) {
    another.execute([] {
      InTwoThreads(
          Wait::kForLoop, [] {}, [] { std::this_thread::sleep_for(kMoment); });
    });
  }));
}

// isolate() protects nothing from what is in an execute() inside of it.
TEST_F(TbbContractTest, ExecuteLeavesTheIsolatedRegion) {
  EXPECT_TRUE(IsTakenIn(kLongest, [](tbb::task_arena* arena, tbb::task_group* busy) {
    tbb::this_task_arena::isolate([&] { arena->execute([&] { busy->wait(); }); });
  }));
}

#ifdef __SANITIZE_THREAD__
constexpr int kExitCodeOfThreadSanitizer = 66;

// Alone in its eight bytes: of those, ThreadSanitizer remembers the last few accesses, and waiting
// for a flag is many.
struct alignas(64) Unlocked {
  int value = 0;
};

TEST(TbbStandInDeathTest, TwoStepsAreEnoughToShowARace) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        Unlocked unlocked;
        tbb::parallel_for(0, 2, [&](int /*i*/) { ++unlocked.value; });
        std::exit(0);
      },
      ::testing::ExitedWithCode(kExitCodeOfThreadSanitizer), "data race");
}

TEST(TbbStandInDeathTest, ATakenTaskIsNotOrderedAfterTheTaskThatItsThreadWaitsFor) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        const tbb::global_control allow(tbb::global_control::max_allowed_parallelism, 2);
        tbb::task_arena arena(2);
        Unlocked unlocked;
        std::atomic<bool> is_written{false};
        std::atomic<bool> is_taken{false};
        arena.execute([&] {
          tbb::task_group busy;
          tbb::task_group outer;
          busy.run([&] {
            ++unlocked.value;
            Set(&is_written);
            Await(is_taken);
          });
          Await(is_written);
          outer.run([&] {
            ++unlocked.value;
            Set(&is_taken);
          });
          busy.wait();
          outer.wait();
        });
        std::exit(0);
      },
      ::testing::ExitedWithCode(kExitCodeOfThreadSanitizer), "data race");
}

TEST(TbbStandInDeathTest, TheLoopsOfTwoCallersAreNotOrdered) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        const tbb::global_control allow(tbb::global_control::max_allowed_parallelism, 2);
        tbb::task_arena arena(2);
        Unlocked unlocked;
        std::atomic<bool> is_first_done{false};
        const auto run_loop = [&](bool writes_here) {
          const std::thread::id caller = std::this_thread::get_id();
          arena.execute([&] {
            tbb::parallel_for(0, 2, [&](int /*i*/) {
              if ((std::this_thread::get_id() == caller) == writes_here) {
                ++unlocked.value;
              }
            });
          });
        };
        std::thread first([&] {
          run_loop(false);
          Set(&is_first_done);
        });
        std::thread second([&] {
          Await(is_first_done);
          run_loop(true);
        });
        first.join();
        second.join();
        std::exit(0);
      },
      ::testing::ExitedWithCode(kExitCodeOfThreadSanitizer), "data race");
}
#endif

}  // namespace
}  // namespace isoscope
