#include "server/call/bell.h"

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "server/access/access_control.h"

namespace isoscope::server {
namespace {

TEST(BellTest, RopesRingTheFunction) {
  int rings = 0;
  Bell bell;
  const std::function<void()> rope = bell.Rope();
  rope();  // nothing hangs yet
  bell.Hang([&] { ++rings; });
  rope();
  bell.Rope()();
  EXPECT_EQ(rings, 2);
}

TEST(BellTest, AfterSilenceNothingRingsNorOwnsTheCall) {
  const auto call = std::make_shared<int>(0);
  Bell bell;
  bell.Hang([call] { ++*call; });
  const std::function<void()> rope = bell.Rope();
  bell.Silence();
  EXPECT_EQ(call.use_count(), 1);
  bell.Hang([call] { ++*call; });
  rope();
  EXPECT_EQ(*call, 0);
  EXPECT_EQ(call.use_count(), 1);
}

TEST(BellTest, ARopeOutlivesTheBell) {
  std::function<void()> rope;
  {
    Bell bell;
    bell.Hang([] { FAIL() << "the call is gone"; });
    rope = bell.Rope();
  }
  rope();
}

// What a token ends must not be destroyed by the watch of tokens: its service may be gone.
TEST(BellTest, TheEndOfACallWaitsForTheWatchOfItsToken) {
  const auto grant = std::make_shared<AccessGrant>(AccessToken{}, base::MonotonicNow());
  const Caller caller(grant);
  absl::Notification rings;
  absl::Notification may_end;
  std::atomic<bool> has_ended = false;
  Bell bell;
  bell.Hang([&] {
    rings.Notify();
    may_end.WaitForNotification();
    has_ended = true;
  });
  const WithdrawalWatch watch = caller.WhenWithdrawn(bell.Rope());
  std::thread watcher([&] { grant->EndUsers(); });
  rings.WaitForNotification();
  std::thread releaser([&] {
    absl::SleepFor(absl::Milliseconds(20));  // Silence has most likely begun
    may_end.Notify();
  });
  bell.Silence();
  EXPECT_TRUE(has_ended);
  watcher.join();
  releaser.join();
}

}  // namespace
}  // namespace isoscope::server
