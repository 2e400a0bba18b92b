#include "core/base/memory_budget.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

// Long enough for another thread to do what it must not do.
constexpr absl::Duration kAWhile = absl::Milliseconds(50);

TEST(MemoryBudgetTest, AReservationThatShrinksGivesTheRestBackAtOnce) {
  MemoryBudget budget(1000);
  const Cancellation never;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto shrinking, budget.Reserve(1000, never));
    shrinking.ShrinkTo(2000);
    EXPECT_EQ(budget.reserved_bytes(), 1000U) << "it never grows";
    shrinking.ShrinkTo(300);
    EXPECT_EQ(budget.reserved_bytes(), 300U);
    EXPECT_EQ(shrinking.bytes(), 300U);
    const MemoryBudget::Reservation moved = std::move(shrinking);
    EXPECT_THAT(budget.Reserve(700, never), IsOk());
    EXPECT_EQ(budget.reserved_bytes(), 300U);
  }
  EXPECT_EQ(budget.reserved_bytes(), 0U);
}

TEST(MemoryBudgetTest, AllOfItCanBeReservedAgainAndAgain) {
  MemoryBudget budget(1000);
  EXPECT_EQ(budget.capacity_bytes(), 1000U);
  const Cancellation never;
  for (int i = 0; i < 3; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, budget.Reserve(1000, never));
    EXPECT_THAT(budget.Reserve(0, never), IsOk()) << "nothing is always free";
  }
}

TEST(MemoryBudgetTest, WhatWillNeverFitIsRefusedAtOnceWithTheFigures) {
  MemoryBudget budget(1000);
  const Cancellation never;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, budget.Reserve(1000, never));
  for (const std::size_t bytes : {std::size_t{1001}, std::numeric_limits<std::size_t>::max()}) {
    EXPECT_THAT(budget.Reserve(bytes, never),
                StatusIs(absl::StatusCode::kResourceExhausted,
                         AllOf(HasSubstr(std::to_string(bytes)), HasSubstr("at most 1000"))));
  }
  MemoryBudget none(0);
  EXPECT_THAT(none.Reserve(1, never), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_THAT(none.Reserve(0, never), IsOk());
}

TEST(MemoryBudgetTest, WhoNeedsMoreThanIsLeftWaitsForIt) {
  MemoryBudget budget(1000);
  const Cancellation never;
  std::unique_ptr<MemoryBudget::Reservation> first;
  std::unique_ptr<MemoryBudget::Reservation> second;
  first = std::make_unique<MemoryBudget::Reservation>(*budget.Reserve(600, never));
  second = std::make_unique<MemoryBudget::Reservation>(*budget.Reserve(400, never));
  absl::Notification is_reserved;
  std::thread waiter([&] {
    EXPECT_THAT(budget.Reserve(500, never), IsOk());
    is_reserved.Notify();
  });
  EXPECT_FALSE(is_reserved.WaitForNotificationWithTimeout(kAWhile));
  second.reset();
  EXPECT_FALSE(is_reserved.WaitForNotificationWithTimeout(kAWhile)) << "400 bytes were free";
  first.reset();
  waiter.join();
  EXPECT_TRUE(is_reserved.HasBeenNotified());
}

TEST(MemoryBudgetTest, ReservationGoesWithItsOwner) {
  MemoryBudget budget(10);
  const Cancellation never;
  const Cancellation late(absl::InfinitePast());
  std::unique_ptr<MemoryBudget::Reservation> owner;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto reservation, budget.Reserve(10, never));
    owner = std::make_unique<MemoryBudget::Reservation>(std::move(reservation));
  }
  const Cancellation soon(absl::Now() + kAWhile);
  EXPECT_THAT(budget.Reserve(1, soon), StatusIs(absl::StatusCode::kDeadlineExceeded))
      << "what was moved from gave its bytes back";
  owner.reset();
  EXPECT_THAT(budget.Reserve(10, never), IsOk());
}

TEST(MemoryBudgetTest, CancellationAndDeadlineEndTheWait) {
  MemoryBudget budget(1000);
  const Cancellation never;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto most, budget.Reserve(999, never));
  const Cancellation soon(absl::Now() + kAWhile);
  EXPECT_THAT(budget.Reserve(2, soon), StatusIs(absl::StatusCode::kDeadlineExceeded));
  EXPECT_GE(absl::Now(), soon.deadline());

  Cancellation cancellation;
  absl::Notification is_waiting;
  std::thread waiter([&] {
    is_waiting.Notify();
    EXPECT_THAT(budget.Reserve(2, cancellation), StatusIs(absl::StatusCode::kCancelled));
  });
  is_waiting.WaitForNotification();
  absl::SleepFor(kAWhile);
  cancellation.Cancel();
  waiter.join();
  // Those who gave up hold nothing.
  EXPECT_THAT(budget.Reserve(1, never), IsOk());
}

TEST(MemoryBudgetTest, CancelledWorkGetsNothingEvenIfThereIsRoom) {
  MemoryBudget budget(1000);
  Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(budget.Reserve(1, cancelled), StatusIs(absl::StatusCode::kCancelled));
  const Cancellation late(absl::InfinitePast());
  EXPECT_THAT(budget.Reserve(1, late), StatusIs(absl::StatusCode::kDeadlineExceeded));
}

TEST(MemoryBudgetTest, ManyThreadsTogetherNeverHoldMoreThanAllAndAllComeToAnEnd) {
  constexpr std::size_t kCapacity = 1000;
  MemoryBudget budget(kCapacity);
  const Cancellation never;
  std::atomic<std::size_t> held{0};
  std::atomic<int> granted{0};
  const auto work = [&](std::uint64_t seed) {
    for (std::uint64_t step = 0; step < 300; ++step) {
      const auto bytes =
          static_cast<std::size_t>(static_cast<double>(kCapacity + 1) * RandomUnit(seed, 2 * step));
      if (RandomUnit(seed, 2 * step + 1) < 0.1) {
        // Some give up.
        const Cancellation soon(absl::Now() + absl::Microseconds(50));
        const auto reservation = budget.Reserve(bytes, soon);
        if (!reservation.ok()) {
          EXPECT_THAT(reservation, StatusIs(absl::StatusCode::kDeadlineExceeded));
        }
        continue;
      }
      const auto reservation = budget.Reserve(bytes, never);
      ASSERT_THAT(reservation, IsOk());
      EXPECT_LE(held.fetch_add(bytes) + bytes, kCapacity);
      ++granted;
      std::this_thread::yield();
      held.fetch_sub(bytes);
    }
  };
  std::vector<std::thread> threads;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    threads.emplace_back(work, seed);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_GT(granted.load(), 1000);
  EXPECT_THAT(budget.Reserve(kCapacity, never), IsOk()) << "bytes were lost";
}

}  // namespace
}  // namespace isoscope::base
