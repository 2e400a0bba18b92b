// Three parts of a cancellation, each with its races:
//
// - Check: the deadline and the flag, and which of the two wins.
// - Callbacks: called once, by the first Cancel or at once; never outside their life; free to
//   destroy themselves.
// - AwaitOrCancelled: ends by its predicate, by the deadline, or by Cancel, and loses no wake-up.

#include "core/base/cancellation.h"

#include <atomic>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;

TEST(CancellationTest, DefaultNeverExpires) {
  Cancellation cancellation;
  ISOSCOPE_EXPECT_OK(cancellation.Check());
  EXPECT_EQ(cancellation.deadline(), MonotonicTime::InfiniteFuture());
}

TEST(CancellationTest, PassedDeadlineIsDeadlineExceededAndACallOfCancelWins) {
  Cancellation cancellation(MonotonicNow() - absl::Seconds(1));
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kDeadlineExceeded, _));
  EXPECT_FALSE(cancellation.is_cancelled());
  cancellation.Cancel();
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kCancelled, _));
}

TEST(CancellationTest, CancelBeforeTheDeadlineIsCancelled) {
  Cancellation cancellation(MonotonicNow() + absl::Hours(1));
  ISOSCOPE_EXPECT_OK(cancellation.Check());
  cancellation.Cancel();
  EXPECT_TRUE(cancellation.is_cancelled());
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kCancelled, _));
}

TEST(CancellationTest, CallbacksAreCalledOnceByTheFirstCancel) {
  Cancellation cancellation;
  int first = 0;
  int second = 0;
  const Cancellation::Callback a(cancellation, [&] {
    EXPECT_TRUE(cancellation.is_cancelled());
    ++first;
  });
  const Cancellation::Callback b(cancellation, [&] { ++second; });
  EXPECT_EQ(first + second, 0);
  cancellation.Cancel();
  cancellation.Cancel();
  EXPECT_EQ(first, 1);
  EXPECT_EQ(second, 1);
}

TEST(CancellationTest, ACallbackThatComesTooLateIsCalledAtOnce) {
  Cancellation cancellation;
  cancellation.Cancel();
  int calls = 0;
  {
    const Cancellation::Callback callback(cancellation, [&] { ++calls; });
    EXPECT_EQ(calls, 1);
  }
  EXPECT_EQ(calls, 1);
}

TEST(CancellationTest, ADestroyedCallbackIsNotCalled) {
  Cancellation cancellation;
  int calls = 0;
  std::optional<Cancellation::Callback> first;
  std::optional<Cancellation::Callback> second;
  first.emplace(cancellation, [&] { ++calls; });
  second.emplace(cancellation, [&] { ++calls; });
  first.reset();
  cancellation.Cancel();
  EXPECT_EQ(calls, 1);
}

TEST(CancellationTest, ADeadlineCallsNothingBack) {
  const Cancellation cancellation(MonotonicNow() - absl::Seconds(1));
  const Cancellation::Callback callback(cancellation, [] { ADD_FAILURE(); });
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kDeadlineExceeded, _));
}

TEST(CancellationTest, ACallbackMayDestroyItselfAndMakeAnother) {
  Cancellation cancellation;
  int calls = 0;
  auto callback = std::make_unique<std::optional<Cancellation::Callback>>();
  auto* const slot = callback.get();
  slot->emplace(cancellation, [&cancellation, &calls, slot] {
    Cancellation& its = cancellation;  // the captures go with the callback
    int& count = calls;
    slot->reset();
    ++count;
    const Cancellation::Callback late(its, [&count] { ++count; });
  });
  cancellation.Cancel();
  EXPECT_EQ(calls, 2);
}

TEST(CancellationTest, DestroyingACallbackWaitsForItsCall) {
  Cancellation cancellation;
  std::atomic<bool> has_begun{false};
  bool has_ended = false;  // plain: ThreadSanitizer would see a race
  std::optional<Cancellation::Callback> callback;
  callback.emplace(cancellation, [&] {
    has_begun = true;
    absl::SleepFor(absl::Milliseconds(20));
    has_ended = true;
  });
  std::thread canceller([&] { cancellation.Cancel(); });
  while (!has_begun) {
    std::this_thread::yield();
  }
  callback.reset();
  EXPECT_TRUE(has_ended);
  canceller.join();
}

TEST(CancellationTest, CancelAndCallbacksRaceWithoutACallBeforeOrAfterALife) {
  for (int round = 0; round < 300; ++round) {
    Cancellation cancellation;
    std::vector<std::thread> threads;
    for (int i = 0; i < 3; ++i) {
      threads.emplace_back([&] {
        for (int j = 0; j < 20; ++j) {
          const bool was_cancelled = cancellation.is_cancelled();
          auto calls = std::make_unique<int>(0);  // freed after the callback
          {
            const Cancellation::Callback callback(cancellation, [&calls] { ++*calls; });
            EXPECT_TRUE(!was_cancelled || *calls == 1);
          }
          EXPECT_LE(*calls, 1);
          EXPECT_TRUE(*calls == 0 || cancellation.is_cancelled());
        }
      });
    }
    for (int i = 0; i < 2; ++i) {
      threads.emplace_back([&] { cancellation.Cancel(); });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
  }
}

TEST(AwaitOrCancelledTest, ATruePredicateWinsAndIsNotAskedAgain) {
  Cancellation cancellation;
  cancellation.Cancel();
  Mutex mutex;
  CondVar changed;
  int calls = 0;
  ISOSCOPE_EXPECT_OK(AwaitOrCancelled(cancellation, &mutex, &changed, [&] { return ++calls > 0; }));
  EXPECT_EQ(calls, 1);
  EXPECT_THAT(AwaitOrCancelled(cancellation, &mutex, &changed, [] { return false; }),
              StatusIs(absl::StatusCode::kCancelled, _));
}

TEST(AwaitOrCancelledTest, WaitsForSignals) {
  const Cancellation cancellation(MonotonicNow() + absl::Hours(1));
  Mutex mutex;
  CondVar changed;
  int ready = 0;
  std::thread signaller([&] {
    for (int i = 0; i < 100; ++i) {
      const MutexLock lock(&mutex);
      ++ready;
      changed.Signal();
    }
  });
  for (int i = 0; i < 100; ++i) {
    ISOSCOPE_EXPECT_OK(AwaitOrCancelled(cancellation, &mutex, &changed, [&] {
      if (ready == 0) {
        return false;
      }
      --ready;
      return true;
    }));
  }
  signaller.join();
}

TEST(AwaitOrCancelledTest, EndsAtTheDeadline) {
  const MonotonicTime deadline = MonotonicNow() + absl::Milliseconds(20);
  const Cancellation cancellation(deadline);
  Mutex mutex;
  CondVar changed;
  EXPECT_THAT(AwaitOrCancelled(cancellation, &mutex, &changed, [] { return false; }),
              StatusIs(absl::StatusCode::kDeadlineExceeded, _));
  EXPECT_GE(MonotonicNow(), deadline);
}

// There is no deadline, so a lost wake-up would hang the test.
TEST(AwaitOrCancelledTest, CancelWakesAllWhoWaitWhenever) {
  for (int round = 0; round < 300; ++round) {
    Cancellation cancellation;
    Mutex mutex;
    CondVar changed;
    std::vector<std::thread> threads;
    for (int i = 0; i < 3; ++i) {
      threads.emplace_back([&] {
        EXPECT_THAT(AwaitOrCancelled(cancellation, &mutex, &changed, [] { return false; }),
                    StatusIs(absl::StatusCode::kCancelled, _));
      });
    }
    if (round % 2 == 0) {
      absl::SleepFor(absl::Microseconds(100));
    }
    cancellation.Cancel();
    for (std::thread& thread : threads) {
      thread.join();
    }
  }
}

}  // namespace
}  // namespace isoscope::base
