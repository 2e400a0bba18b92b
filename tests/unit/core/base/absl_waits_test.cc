#include "core/base/absl_waits.h"

#include <cstdint>
#include <ctime>
#include <thread>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/date_functions.h"

namespace isoscope::base {
namespace {

// Far more than the waits below take, far less than the jump.
constexpr absl::Duration kLimit = absl::Minutes(10);
constexpr std::int64_t kJumpSeconds = 3600;

class AbslWaitsTest : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(AreAbslWaitsMonotonic()); }
  void TearDown() override { testing::SetDateOffset(0); }
};

TEST_F(AbslWaitsTest, AWaitEndsInTimeThoughTheDateIsSetBack) {
  const MonotonicTime begin = MonotonicNow();
  std::thread sets([] {
    absl::SleepFor(absl::Milliseconds(100));
    testing::SetDateOffset(-kJumpSeconds);
  });
  absl::Notification never;
  EXPECT_FALSE(never.WaitForNotificationWithTimeout(absl::Milliseconds(400)));
  EXPECT_GE(MonotonicNow() - begin, absl::Milliseconds(400));
  EXPECT_LT(MonotonicNow() - begin, kLimit);
  sets.join();
}

TEST_F(AbslWaitsTest, AWaitDoesNotEndEarlyThoughTheDateIsSetForth) {
  const MonotonicTime begin = MonotonicNow();
  std::thread sets([] {
    absl::SleepFor(absl::Milliseconds(100));
    testing::SetDateOffset(kJumpSeconds);
  });
  absl::Mutex mutex;
  absl::CondVar never;
  {
    const absl::MutexLock lock(&mutex);
    EXPECT_TRUE(never.WaitWithTimeout(&mutex, absl::Milliseconds(400)));
  }
  EXPECT_GE(MonotonicNow() - begin, absl::Milliseconds(400));
  sets.join();
}

// After a jump absl::Now may have the old date for seconds. gRPC's ends come from the system's date.
TEST_F(AbslWaitsTest, AWaitUntilTheSystemsDateEndsInTimeWhileAbseilsIsOld) {
  absl::Mutex mutex;
  absl::CondVar never;
  for (int round = 0; round < 20; ++round) {
    testing::SetDateOffset(round % 2 == 0 ? kJumpSeconds : 0);
    const MonotonicTime begin = MonotonicNow();
    timespec date{};
    ASSERT_EQ(clock_gettime(CLOCK_REALTIME, &date), 0);
    const absl::MutexLock lock(&mutex);
    EXPECT_TRUE(
        never.WaitWithDeadline(&mutex, absl::TimeFromTimespec(date) + absl::Milliseconds(20)));
    EXPECT_GE(MonotonicNow() - begin, absl::Milliseconds(20)) << round;
    EXPECT_LT(MonotonicNow() - begin, kLimit) << round;
  }
}

TEST_F(AbslWaitsTest, AWaitUntilAbseilsDateEndsInTimeWhileThatIsOld) {
  absl::Mutex mutex;
  absl::CondVar never;
  for (int round = 0; round < 20; ++round) {
    testing::SetDateOffset(round % 2 == 0 ? kJumpSeconds : 0);
    const MonotonicTime begin = MonotonicNow();
    const absl::MutexLock lock(&mutex);
    EXPECT_TRUE(never.WaitWithTimeout(&mutex, absl::Milliseconds(20)));
    EXPECT_GE(MonotonicNow() - begin, absl::Milliseconds(20)) << round;
    EXPECT_LT(MonotonicNow() - begin, kLimit) << round;
  }
}

TEST_F(AbslWaitsTest, ASignalEndsAWaitBeforeItsTime) {
  for (int round = 0; round < 200; ++round) {
    absl::Notification done;
    std::thread notifies([&] { done.Notify(); });
    ASSERT_TRUE(done.WaitForNotificationWithTimeout(kLimit));
    notifies.join();
  }
}

TEST_F(AbslWaitsTest, WaitsWithoutEndAndWaitsWhoseEndHasPassedWorkAsBefore) {
  absl::Mutex mutex;
  bool is_true = false;
  std::thread sets([&] {
    absl::SleepFor(absl::Milliseconds(20));
    const absl::MutexLock lock(&mutex);
    is_true = true;
  });
  {
    const absl::MutexLock lock(&mutex);
    EXPECT_FALSE(
        mutex.AwaitWithTimeout(absl::Condition(
                                   +[](bool* value) { return !*value && false; }, &is_true),
                               absl::ZeroDuration()));
    EXPECT_FALSE(mutex.AwaitWithTimeout(absl::Condition(
                                            +[](bool*) { return false; }, &is_true),
                                        -absl::Hours(1)));
    mutex.Await(absl::Condition(&is_true));
    EXPECT_TRUE(mutex.AwaitWithTimeout(absl::Condition(&is_true), absl::InfiniteDuration()));
  }
  sets.join();
}

}  // namespace
}  // namespace isoscope::base
