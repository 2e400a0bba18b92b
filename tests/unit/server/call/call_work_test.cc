#include "server/call/call_work.h"

#include <memory>
#include <optional>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::Not;

constexpr char kClient[] = "peer ipv4:192.0.2.1:1";

// A caller with one frame at a time and two in all: its rate gives no others during a test.
Caller Limited() {
  AccessToken token;
  token.name = "n";
  token.max_frames_per_second = 1e-3;
  token.max_concurrent_frames = 1;
  return Caller(std::make_shared<AccessGrant>(token, base::MonotonicNow()));
}

absl::Status TakeShare(const Caller& caller, CallWork* work) {
  absl::Status use = work->TakeUse(caller, CallerUse::kFrame);
  return use.ok() ? work->TakeRate(/*is_moving=*/false) : use;
}

class CallWorkTest : public ::testing::Test {
 protected:
  Admission queue_{{.limits = {.max_working = 1, .max_waiting = 0}}};
  const Caller caller_ = Limited();
};

TEST_F(CallWorkTest, AWorkWithoutAPlaceReturnsItsShare) {
  CallWork first(&queue_, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(first.TakePlace("another"));
  for (int i = 0; i < 5; ++i) {
    CallWork work(&queue_, base::MonotonicTime::InfiniteFuture());
    ISOSCOPE_ASSERT_OK(TakeShare(caller_, &work));
    EXPECT_THAT(work.TakePlace(kClient), StatusIs(absl::StatusCode::kResourceExhausted));
    CallWork next(&queue_, base::MonotonicTime::InfiniteFuture());
    EXPECT_THAT(next.TakeUse(caller_, CallerUse::kFrame), IsOk()) << "the use is free at once";
  }
}

TEST_F(CallWorkTest, AWorkThatSomethingElseRefusesReturnsItsShare) {
  for (int i = 0; i < 5; ++i) {
    CallWork work(&queue_, base::MonotonicTime::InfiniteFuture());
    ISOSCOPE_ASSERT_OK(TakeShare(caller_, &work));
    work.ReturnShare();
    CallWork next(&queue_, base::MonotonicTime::InfiniteFuture());
    EXPECT_THAT(next.TakeUse(caller_, CallerUse::kFrame), IsOk());
  }
}

TEST_F(CallWorkTest, AWorkAboveTheRateReturnsItsUse) {
  std::optional<CallWork> works[3];
  for (int i = 0; i < 2; ++i) {
    works[i].emplace(&queue_, base::MonotonicTime::InfiniteFuture());
    ISOSCOPE_ASSERT_OK(TakeShare(caller_, &*works[i]));
    works[i]->GiveBackShare();
  }
  works[2].emplace(&queue_, base::MonotonicTime::InfiniteFuture());
  EXPECT_THAT(TakeShare(caller_, &*works[2]), StatusIs(absl::StatusCode::kResourceExhausted));
  CallWork next(&queue_, base::MonotonicTime::InfiniteFuture());
  EXPECT_THAT(next.TakeUse(caller_, CallerUse::kFrame), IsOk());
}

TEST_F(CallWorkTest, TheFrameOfAWorkThatHadItsTurnIsSpent) {
  for (int i = 0; i < 2; ++i) {
    CallWork work(&queue_, base::MonotonicTime::InfiniteFuture());
    ISOSCOPE_ASSERT_OK(TakeShare(caller_, &work));
    ISOSCOPE_ASSERT_OK(work.TakePlace(kClient));
    absl::Notification done;
    work.Schedule([&](const absl::Status& turn) {
      EXPECT_THAT(turn, IsOk());
      done.Notify();
    });
    done.WaitForNotification();
    work.GiveBackPlace();
    work.GiveBackShare();
  }
  CallWork third(&queue_, base::MonotonicTime::InfiniteFuture());
  EXPECT_THAT(TakeShare(caller_, &third), Not(IsOk()));
}

TEST(CallWorkOfManyTest, TheFrameOfAWorkThatMadeRoomForAnotherClientIsReturned) {
  AccessToken token;
  token.name = "n";
  token.max_frames_per_second = 1e-3;  // two at once
  const Caller caller(std::make_shared<AccessGrant>(token, base::MonotonicNow()));
  Admission queue({.limits = {.max_working = 1, .max_waiting = 2}});
  absl::Notification go_on;
  absl::Notification first_ended;
  absl::Notification second_ended;
  absl::Notification other_ended;
  CallWork working(&queue, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(working.TakePlace("working"));
  absl::Notification begun;
  working.Schedule([&](const absl::Status&) {
    begun.Notify();
    go_on.WaitForNotification();
    working.GiveBackPlace();
  });
  begun.WaitForNotification();
  CallWork first(&queue, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(TakeShare(caller, &first));
  ISOSCOPE_ASSERT_OK(first.TakePlace(kClient));
  first.Schedule([&](const absl::Status&) {
    first.GiveBackPlace();
    first_ended.Notify();
  });
  CallWork second(&queue, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(TakeShare(caller, &second));
  ISOSCOPE_ASSERT_OK(second.TakePlace(kClient));
  second.Schedule([&](const absl::Status& turn) {
    EXPECT_THAT(turn, StatusIs(absl::StatusCode::kResourceExhausted));
    EXPECT_THAT(caller.TakeFrame(/*is_moving=*/false), IsOk()) << "that of the second work";
    EXPECT_THAT(caller.TakeFrame(/*is_moving=*/false), Not(IsOk())) << "the first is not ended";
    second_ended.Notify();
  });
  CallWork other(&queue, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(other.TakePlace("another"));
  other.Schedule([&](const absl::Status&) { other_ended.Notify(); });
  second_ended.WaitForNotification();
  go_on.Notify();
  first_ended.WaitForNotification();
  other_ended.WaitForNotification();
}

TEST_F(CallWorkTest, AWorkThatIsCancelledBeforeItIsScheduledEnds) {
  CallWork first(&queue_, base::MonotonicTime::InfiniteFuture());
  ISOSCOPE_ASSERT_OK(first.TakePlace(kClient));
  first.Cancel();
  absl::Notification done;
  first.Schedule([&](const absl::Status&) { done.Notify(); });
  done.WaitForNotification();
  EXPECT_TRUE(first.cancellation().is_cancelled());
}

TEST_F(CallWorkTest, MemoryOutlivesTheWorkOfWhichItIsReleased) {
  base::MemoryBudget budget(1000);
  std::optional<base::MemoryBudget::Reservation> released;
  {
    CallWork work(&queue_, base::MonotonicTime::InfiniteFuture());
    EXPECT_FALSE(work.ReleaseMemory(1).has_value()) << "none was kept";
    work.ShrinkMemory(1);
    ISOSCOPE_ASSERT_OK(work.KeepMemory(budget.Reserve(900, work.cancellation())));
    work.ShrinkMemory(600);
    EXPECT_EQ(budget.reserved_bytes(), 600);
    released.emplace(*work.ReleaseMemory(100));
  }
  EXPECT_EQ(budget.reserved_bytes(), 100);
  released.reset();
  EXPECT_EQ(budget.reserved_bytes(), 0);
}

}  // namespace
}  // namespace isoscope::server
