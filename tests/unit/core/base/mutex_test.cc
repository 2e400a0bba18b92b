#include "core/base/mutex.h"

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/date_functions.h"

namespace isoscope::base {
namespace {

constexpr int kThreads = 4;
constexpr int kRounds = 2000;

// Runs `body` on kThreads threads and waits for them.
template <typename Body>
void RunOnThreads(Body body) {
  std::vector<std::thread> threads;
  threads.reserve(kThreads);
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back(body);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

TEST(MutexTest, OneThreadAtATimeIsInside) {
  Mutex mutex;
  int count = 0;  // plain: ThreadSanitizer would see a race
  RunOnThreads([&] {
    for (int i = 0; i < kRounds; ++i) {
      const MutexLock lock(&mutex);
      ++count;
    }
  });
  EXPECT_EQ(count, kThreads * kRounds);
}

TEST(MutexTest, TryLockFailsWhereAnotherThreadHoldsIt) {
  Mutex mutex;
  mutex.Lock();
  std::thread([&] {
    const bool is_mine = mutex.TryLock();
    EXPECT_FALSE(is_mine);
    if (is_mine) {
      mutex.Unlock();
    }
  }).join();
  mutex.Unlock();
  const bool is_mine = mutex.TryLock();
  EXPECT_TRUE(is_mine);
  if (is_mine) {
    mutex.Unlock();
  }
}

TEST(MutexTest, MaybeLocksWhatThereIs) {
  Mutex mutex;
  int count = 0;
  RunOnThreads([&] {
    for (int i = 0; i < kRounds; ++i) {
      const MutexLockMaybe none(nullptr);
      const MutexLockMaybe lock(&mutex);
      ++count;
    }
  });
  EXPECT_EQ(count, kThreads * kRounds);
}

TEST(SharedMutexTest, ReadersAreTogetherAndAWriterIsAlone) {
  SharedMutex mutex;
  int count = 0;
  {
    const ReaderMutexLock here(&mutex);
    std::thread([&] { const ReaderMutexLock there(&mutex); }).join();  // or this would hang
  }
  RunOnThreads([&] {
    for (int i = 0; i < kRounds; ++i) {
      {
        const WriterMutexLock lock(&mutex);
        ++count;
      }
      const ReaderMutexLock lock(&mutex);
      EXPECT_GT(count, 0);
    }
  });
  EXPECT_EQ(count, kThreads * kRounds);
}

TEST(CondVarTest, ASignalWakesOneThatAwaitsAPredicate) {
  Mutex mutex;
  CondVar changed;
  int ready = 0;
  int taken = 0;
  std::thread producer([&] {
    for (int i = 0; i < kThreads * kRounds; ++i) {
      const MutexLock lock(&mutex);
      ++ready;
      changed.Signal();
    }
  });
  RunOnThreads([&] {
    for (int i = 0; i < kRounds; ++i) {
      const MutexLock lock(&mutex);
      changed.Await(&mutex, [&] { return ready > 0; });
      --ready;
      ++taken;
    }
  });
  producer.join();
  EXPECT_EQ(taken, kThreads * kRounds);
  EXPECT_EQ(ready, 0);
}

TEST(CondVarTest, SignalAllWakesAll) {
  Mutex mutex;
  CondVar changed;
  int waiting = 0;
  bool is_open = false;
  std::thread opener([&] {
    const MutexLock lock(&mutex);
    changed.Await(&mutex, [&] { return waiting == kThreads; });
    is_open = true;
    changed.SignalAll();
  });
  RunOnThreads([&] {
    const MutexLock lock(&mutex);
    ++waiting;
    changed.SignalAll();
    changed.Await(&mutex, [&] { return is_open; });
  });
  opener.join();
}

TEST(CondVarTest, ADeadlineEndsTheWait) {
  Mutex mutex;
  CondVar changed;
  const MutexLock lock(&mutex);
  const MonotonicTime deadline = MonotonicNow() + absl::Milliseconds(20);
  EXPECT_FALSE(changed.AwaitUntil(&mutex, deadline, [] { return false; }));
  EXPECT_GE(MonotonicNow(), deadline);
  while (changed.WaitUntil(&mutex, deadline)) {
  }
}

TEST(CondVarTest, AWaitKeepsItsTimeThoughTheDateJumps) {
  for (const std::int64_t jump_seconds : {-3600, 3600}) {
    Mutex mutex;
    CondVar never;
    const MonotonicTime begin = MonotonicNow();
    std::thread sets([jump_seconds] {
      absl::SleepFor(absl::Milliseconds(100));
      testing::SetDateOffset(jump_seconds);
    });
    {
      const MutexLock lock(&mutex);
      const MonotonicTime end = begin + absl::Milliseconds(400);
      EXPECT_FALSE(never.AwaitUntil(&mutex, end, [] { return false; }));
    }
    EXPECT_GE(MonotonicNow() - begin, absl::Milliseconds(400));
    EXPECT_LT(MonotonicNow() - begin, absl::Minutes(10)) << "jump " << jump_seconds;
    sets.join();
    testing::SetDateOffset(0);
  }
}

TEST(CondVarTest, APassedDeadlineStillAsksThePredicate) {
  Mutex mutex;
  CondVar changed;
  const MutexLock lock(&mutex);
  int calls = 0;
  EXPECT_TRUE(
      changed.AwaitUntil(&mutex, MonotonicTime::InfinitePast(), [&] { return ++calls > 0; }));
  EXPECT_FALSE(changed.AwaitUntil(&mutex, MonotonicTime::InfinitePast(), [] { return false; }));
  EXPECT_FALSE(changed.WaitUntil(&mutex, MonotonicTime()));
}

// Deadlines that overflow the nanoseconds of std::chrono or a timespec.
TEST(CondVarTest, FarDeadlinesAreFar) {
  for (const MonotonicTime deadline :
       {MonotonicTime::InfiniteFuture(), MonotonicTime() + absl::Seconds(0x7fffffffffffffff),
        MonotonicTime() + absl::Seconds(9223372036), MonotonicTime() + absl::Seconds(9223372037),
        MonotonicNow() + absl::Hours(24) * 365 * 1000}) {
    Mutex mutex;
    CondVar changed;
    bool is_set = false;
    std::atomic<bool> waits{false};
    std::thread setter([&] {
      while (!waits) {
        absl::SleepFor(absl::Milliseconds(1));
      }
      const MutexLock lock(&mutex);
      is_set = true;
      changed.Signal();
    });
    {
      const MutexLock lock(&mutex);
      EXPECT_TRUE(changed.AwaitUntil(&mutex, deadline, [&] {
        waits = true;
        return is_set;
      })) << deadline - MonotonicTime();
    }
    setter.join();
  }
}

}  // namespace
}  // namespace isoscope::base
