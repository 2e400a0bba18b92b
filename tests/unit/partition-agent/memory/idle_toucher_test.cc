#include "partition-agent/memory/idle_toucher.h"

#include <atomic>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

namespace isoscope::agent {
namespace {

constexpr absl::Duration kAtOnce = absl::Milliseconds(1);
constexpr absl::Duration kNever = absl::Hours(1);

TEST(IdleToucherTest, TouchesAfterWorkUntilNothingIsMissing) {
  std::atomic<int> missing{3};
  absl::Notification done;
  const auto touch = [&] {
    if (missing.load() == 0) {
      done.Notify();
      return false;
    }
    missing.fetch_sub(1);
    return true;
  };
  IdleToucher toucher(
      {.is_busy = [] { return false; }, .touch_some = touch, .idle_after = kAtOnce});
  toucher.NoteWork();
  done.WaitForNotification();
  EXPECT_EQ(missing.load(), 0);
}

TEST(IdleToucherTest, TouchesNothingBeforeTheFirstWork) {
  std::atomic<int> calls{0};
  {
    IdleToucher toucher({.is_busy = [] { return false; },
                         .touch_some = [&] { return calls.fetch_add(1) < 0; },
                         .idle_after = kAtOnce});
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_EQ(calls.load(), 0);
}

TEST(IdleToucherTest, WaitsWhileSomebodyIsBusy) {
  std::atomic<bool> is_busy{true};
  std::atomic<int> asked{0};
  std::atomic<int> touched_while_busy{0};
  absl::Notification done;
  const auto ask = [&] {
    asked.fetch_add(1);
    return is_busy.load();
  };
  const auto touch = [&] {
    touched_while_busy.fetch_add(is_busy.load() ? 1 : 0);
    done.Notify();
    return false;
  };
  IdleToucher toucher({.is_busy = ask, .touch_some = touch, .idle_after = kAtOnce});
  toucher.NoteWork();
  while (asked.load() < 3) {
    absl::SleepFor(kAtOnce);
  }
  is_busy.store(false);
  done.WaitForNotification();
  EXPECT_EQ(touched_while_busy.load(), 0);
}

TEST(IdleToucherTest, EndsAtOnceHoweverLongItWouldWait) {
  IdleToucher toucher(
      {.is_busy = [] { return false; }, .touch_some = [] { return true; }, .idle_after = kNever});
  toucher.NoteWork();
}

}  // namespace
}  // namespace isoscope::agent
