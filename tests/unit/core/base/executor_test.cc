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
  Executor executor(4, 4);
  std::vector<std::unique_ptr<absl::Notification>> done;
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

}  // namespace
}  // namespace isoscope::base
