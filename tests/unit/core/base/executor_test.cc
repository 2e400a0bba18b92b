#include "core/base/executor.h"

#include <atomic>
#include <memory>
#include <vector>

#include "absl/synchronization/notification.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"

namespace isoscope::base {
namespace {

TEST(ExecutorTest, DestructorRunsEverythingThatWasQueued) {
  std::atomic<int> run_count{0};
  {
    Executor executor(3, 1000);
    for (int i = 0; i < 1000; ++i) {
      ASSERT_TRUE(executor.TrySchedule([&run_count] { ++run_count; }));
    }
  }
  EXPECT_EQ(run_count, 1000);
}

TEST(ExecutorTest, FullQueueRefusesAndDropsTheTask) {
  absl::Notification started;
  absl::Notification may_end;
  std::atomic<int> run_count{0};
  {
    Executor executor(1, 2);
    ASSERT_TRUE(executor.TrySchedule([&] {
      started.Notify();
      may_end.WaitForNotification();
    }));
    started.WaitForNotification();  // the queue is empty again
    const auto token = std::make_shared<int>(0);
    ASSERT_TRUE(executor.TrySchedule([&run_count, token] { ++run_count; }));
    ASSERT_TRUE(executor.TrySchedule([&run_count, token] { ++run_count; }));
    EXPECT_FALSE(executor.TrySchedule([&run_count, token] { ++run_count; }));
    EXPECT_EQ(token.use_count(), 3);  // the refused task is gone
    may_end.Notify();
  }
  EXPECT_EQ(run_count, 2);
}

TEST(ExecutorTest, ThreadsRunAtTheSameTime) {
  // Each task waits for all others: with fewer threads than tasks it would never end.
  Mutex mutex;
  CondVar changed;
  int arrived = 0;
  std::vector<std::unique_ptr<absl::Notification>> done;  // outlive the threads
  Executor executor(4, 4);
  for (int i = 0; i < 4; ++i) {
    done.push_back(std::make_unique<absl::Notification>());
    ASSERT_TRUE(executor.TrySchedule([&, notification = done.back().get()] {
      {
        const MutexLock lock(&mutex);
        ++arrived;
        changed.SignalAll();
        changed.Await(&mutex, [&arrived] { return arrived == 4; });
      }
      notification->Notify();
    }));
  }
  for (const auto& notification : done) {
    notification->WaitForNotification();
  }
}

TEST(ExecutorShareTest, DestructorWaitsForTheTasksOfItsOwnerAlone) {
  const auto executor = std::make_shared<Executor>(2, 1000);
  absl::Notification may_end;
  ExecutorShare other(executor, 10);
  ASSERT_TRUE(other.TrySchedule([&] { may_end.WaitForNotification(); }));
  std::atomic<int> run_count{0};
  {
    ExecutorShare share(executor, 100);
    for (int i = 0; i < 100; ++i) {
      ASSERT_TRUE(share.TrySchedule([&run_count] { ++run_count; }));
    }
  }
  EXPECT_EQ(run_count, 100);
  may_end.Notify();
}

TEST(ExecutorShareTest, WhatATaskHoldsIsGoneWhenItsOwnerGoes) {
  const auto executor = std::make_shared<Executor>(3, 1000);
  for (int i = 0; i < 200; ++i) {
    const auto held = std::make_shared<int>(i);
    {
      ExecutorShare share(executor, 3);
      ASSERT_TRUE(share.TrySchedule([held] {}));
      ASSERT_TRUE(share.TrySchedule([held] {}));
    }
    EXPECT_EQ(held.use_count(), 1);
  }
}

TEST(ExecutorShareTest, AnOwnerWithTooManyTasksIsRefusedAndOthersAreNot) {
  const auto executor = std::make_shared<Executor>(1, 1000);
  absl::Notification may_end;
  ExecutorShare greedy(executor, 2);
  ExecutorShare other(executor, 2);
  ASSERT_TRUE(greedy.TrySchedule([&] { may_end.WaitForNotification(); }));
  ASSERT_TRUE(greedy.TrySchedule([] {}));
  EXPECT_FALSE(greedy.TrySchedule([] {}));
  EXPECT_TRUE(other.TrySchedule([] {}));
  may_end.Notify();
}

}  // namespace
}  // namespace isoscope::base
