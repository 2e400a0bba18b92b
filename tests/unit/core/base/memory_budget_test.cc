// The rule of the queue, on a clock that stands still, and use by real threads:
//
// - MemoryBudgetQueueTest moves the clock itself: order of arrival, overtaking, and its end after
//   kMaxOvertakenDuration.
// - A model of the rule takes random arrivals, releases and cancellations.
// - The other tests let threads wait: sizes, moves, cancellations and deadlines.

#include "core/base/memory_budget.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <list>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

// Long enough for another thread to break the rule.
constexpr absl::Duration kAWhile = absl::Milliseconds(50);

// Far longer than anything takes. A wrong rule then fails the test rather than hang it.
constexpr absl::Duration kGiveUp = absl::Seconds(20);

// A budget whose clock stands still, and threads that wait for it. No test sleeps.
class MemoryBudgetQueueTest : public ::testing::Test {
 protected:
  // A thread that reserves, and its reservation.
  class Holder {
   public:
    Holder(MemoryBudget* budget, std::size_t bytes)
        : thread_([this, budget, bytes] {
            auto reservation = budget->Reserve(bytes, cancellation_);
            const MutexLock lock(&mutex_);
            status_ = reservation.status();
            if (reservation.ok()) {
              reservation_.emplace(*std::move(reservation));
            }
            has_returned_ = true;
            returned_.Signal();
          }) {}
    ~Holder() {
      cancellation_.Cancel();
      thread_.join();
    }

    // Waits for the bytes, and gives them back.
    void Release() {
      EXPECT_THAT(AwaitReturn(), IsOk());
      const MutexLock lock(&mutex_);
      reservation_.reset();
    }
    // Ends its wait.
    void Cancel() {
      cancellation_.Cancel();
      EXPECT_THAT(AwaitReturn(), StatusIs(absl::StatusCode::kCancelled));
    }

   private:
    absl::Status AwaitReturn() {
      const MutexLock lock(&mutex_);
      const bool has_returned = returned_.AwaitUntil(
          &mutex_, MonotonicNow() + (HasFailure() ? absl::ZeroDuration() : kGiveUp),
          [this] { return has_returned_; });
      return has_returned ? status_ : absl::UnknownError("it still waits");
    }

    Cancellation cancellation_;
    Mutex mutex_;
    CondVar returned_;
    bool has_returned_ = false;
    absl::Status status_;
    std::optional<MemoryBudget::Reservation> reservation_;
    std::thread thread_;
  };

  // Begins a reservation that is served at once.
  std::unique_ptr<Holder> Hold(std::size_t bytes) {
    const std::size_t before = budget_.reserved_bytes();
    auto holder = std::make_unique<Holder>(&budget_, bytes);
    AwaitThat([&] { return budget_.reserved_bytes() == before + bytes; });
    return holder;
  }
  // Begins a reservation that must wait.
  std::unique_ptr<Holder> Wait(std::size_t bytes) {
    const std::size_t before = budget_.waiting_count();
    auto holder = std::make_unique<Holder>(&budget_, bytes);
    AwaitThat([&] { return budget_.waiting_count() == before + 1; });
    return holder;
  }
  template <typename Predicate>
  static void AwaitThat(const Predicate& predicate) {
    // After a failure nothing waits, because all waits together would exceed CTest's limit.
    const MonotonicTime give_up = MonotonicNow() + (HasFailure() ? absl::ZeroDuration() : kGiveUp);
    while (!predicate()) {
      ASSERT_LT(MonotonicNow(), give_up) << "the budget is not as it must be";
      std::this_thread::yield();
    }
  }
  void Advance(absl::Duration duration) {
    now_nanoseconds_.fetch_add(absl::ToInt64Nanoseconds(duration));
  }

  std::atomic<std::int64_t> now_nanoseconds_{0};
  MemoryBudget budget_{
      1000, [this] { return MonotonicTime() + absl::Nanoseconds(now_nanoseconds_.load()); }};
};

TEST_F(MemoryBudgetQueueTest, ALargeStepStarvesNoLongerThanItsPatience) {
  const auto first = Hold(600);
  const auto second = Hold(400);
  const auto large = Wait(1000);
  const auto early = Wait(400);
  second->Release();
  EXPECT_EQ(budget_.waiting_count(), 1U) << "the large one does not fit, and is still patient";
  Advance(MemoryBudget::kMaxOvertakenDuration);
  const auto late = Wait(100);
  early->Release();
  EXPECT_EQ(budget_.waiting_count(), 2U) << "somebody overtook the large step";
  EXPECT_EQ(budget_.reserved_bytes(), 600U);
  first->Release();
  EXPECT_EQ(budget_.reserved_bytes(), 1000U) << "the large step is served first";
  EXPECT_EQ(budget_.waiting_count(), 1U);
  large->Release();
  late->Release();
}

TEST_F(MemoryBudgetQueueTest, WhoFitsIsServedWhileTheFirstIsPatient) {
  const auto first = Hold(700);
  const auto large = Wait(1000);
  Advance(MemoryBudget::kMaxOvertakenDuration - absl::Nanoseconds(1));
  const auto small = Hold(300);
  small->Release();
  Advance(absl::Nanoseconds(1));
  const auto late = Wait(300);
  first->Release();
  large->Release();
  late->Release();
}

TEST_F(MemoryBudgetQueueTest, EqualsAreServedInTheOrderOfArrival) {
  const auto all = Hold(1000);
  std::vector<std::unique_ptr<Holder>> holders;
  for (int i = 0; i < 5; ++i) {
    holders.push_back(Wait(600));
  }
  all->Release();
  for (std::size_t i = 0; i < holders.size(); ++i) {
    EXPECT_EQ(budget_.waiting_count(), holders.size() - 1 - i);
    holders[i]->Release();
  }
  EXPECT_EQ(budget_.reserved_bytes(), 0U);
}

TEST_F(MemoryBudgetQueueTest, ACancelledFirstLetsThoseBehindItPass) {
  const auto first = Hold(600);
  const auto large = Wait(1000);
  Advance(2 * MemoryBudget::kMaxOvertakenDuration);
  const auto second = Wait(300);
  const auto third = Wait(100);
  const auto fourth = Wait(500);  // does not fit
  large->Cancel();
  EXPECT_EQ(budget_.waiting_count(), 1U);
  EXPECT_EQ(budget_.reserved_bytes(), 1000U);
  second->Release();
  third->Release();
  EXPECT_EQ(budget_.waiting_count(), 1U);
  first->Release();
  fourth->Release();
}

TEST_F(MemoryBudgetQueueTest, ThePatienceOfTheNextCountsFromItsOwnArrival) {
  const auto first = Hold(600);
  const auto large = Wait(1000);
  Advance(MemoryBudget::kMaxOvertakenDuration);
  const auto next = Wait(900);
  large->Cancel();
  const auto small = Hold(400);  // `next` is first, and waits
  small->Release();
  Advance(MemoryBudget::kMaxOvertakenDuration);
  const auto late = Wait(400);
  first->Release();
  next->Release();
  late->Release();
}

TEST_F(MemoryBudgetQueueTest, NothingIsFreeEvenBehindAnImpatientStep) {
  const auto first = Hold(1000);
  const auto large = Wait(1000);
  Advance(MemoryBudget::kMaxOvertakenDuration);
  EXPECT_THAT(budget_.Reserve(0, Cancellation()), IsOk());
  first->Release();
  large->Release();
}

// A model of the rule takes the same arrivals, releases and cancellations.
TEST_F(MemoryBudgetQueueTest, RandomUseFollowsTheRule) {
  struct Step {
    std::size_t bytes = 0;
    MonotonicTime arrival;
    std::unique_ptr<Holder> holder;
  };
  std::list<Step> waiting;
  std::vector<Step> holding;
  std::size_t free_bytes = 1000;
  MonotonicTime now = MonotonicTime();
  const auto serve = [&] {
    for (auto step = waiting.begin(); step != waiting.end();) {
      if (step->bytes <= free_bytes) {
        free_bytes -= step->bytes;
        holding.push_back(std::move(*step));
        step = waiting.erase(step);
      } else if (step == waiting.begin() &&
                 now - step->arrival >= MemoryBudget::kMaxOvertakenDuration) {
        return;
      } else {
        ++step;
      }
    }
  };
  int overtaken_count = 0;
  int held_back_count = 0;
  for (std::uint64_t i = 0; i < 600; ++i) {
    const double dice = base::RandomUnit(1, 3 * i);
    const double which = base::RandomUnit(1, 3 * i + 1);
    if (dice < 0.4) {
      const auto bytes = static_cast<std::size_t>(1 + 999 * which * which);
      const std::size_t waiting_before = waiting.size();
      const bool fits = bytes <= free_bytes;
      waiting.push_back({bytes, now, nullptr});
      Step& step = waiting.back();
      step.holder = std::make_unique<Holder>(&budget_, bytes);
      serve();
      overtaken_count += waiting_before > 0 && waiting.size() == waiting_before ? 1 : 0;
      held_back_count += fits && waiting.size() > waiting_before ? 1 : 0;
    } else if (dice < 0.7 && !holding.empty()) {
      const auto at = holding.begin() +
                      static_cast<std::ptrdiff_t>(which * static_cast<double>(holding.size()));
      at->holder->Release();
      free_bytes += at->bytes;
      holding.erase(at);
      serve();
    } else if (dice < 0.8 && !waiting.empty()) {
      auto at = waiting.begin();
      std::advance(at, static_cast<std::ptrdiff_t>(which * static_cast<double>(waiting.size())));
      at->holder->Cancel();
      waiting.erase(at);
      serve();
    } else {
      Advance(absl::Milliseconds(30));
      now += absl::Milliseconds(30);
    }
    // A thread that has just begun has arrived once both numbers show it.
    AwaitThat([&] {
      return budget_.waiting_count() == waiting.size() &&
             budget_.reserved_bytes() == 1000 - free_bytes;
    });
    if (HasFatalFailure()) {
      return;
    }
  }
  EXPECT_GT(overtaken_count, 5);
  EXPECT_GT(held_back_count, 5);
}

TEST(MemoryBudgetTest, AReservationThatShrinksGivesTheRestBackAtOnce) {
  MemoryBudget budget(1000);
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
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
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
  for (int i = 0; i < 3; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, budget.Reserve(1000, never));
    EXPECT_THAT(budget.Reserve(0, never), IsOk()) << "nothing is always free";
  }
}

TEST(MemoryBudgetTest, WhatWillNeverFitIsRefusedAtOnceWithTheFigures) {
  MemoryBudget budget(1000);
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
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
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
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
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
  const Cancellation late(MonotonicTime::InfinitePast());
  std::unique_ptr<MemoryBudget::Reservation> owner;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto reservation, budget.Reserve(10, never));
    owner = std::make_unique<MemoryBudget::Reservation>(std::move(reservation));
  }
  const Cancellation soon(MonotonicNow() + kAWhile);
  EXPECT_THAT(budget.Reserve(1, soon), StatusIs(absl::StatusCode::kDeadlineExceeded))
      << "what was moved from gave its bytes back";
  owner.reset();
  EXPECT_THAT(budget.Reserve(10, never), IsOk());
}

TEST(MemoryBudgetTest, CancellationAndDeadlineEndTheWait) {
  MemoryBudget budget(1000);
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto most, budget.Reserve(999, never));
  const Cancellation soon(MonotonicNow() + kAWhile);
  EXPECT_THAT(budget.Reserve(2, soon), StatusIs(absl::StatusCode::kDeadlineExceeded));
  EXPECT_GE(MonotonicNow(), soon.deadline());

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
  const Cancellation late(MonotonicTime::InfinitePast());
  EXPECT_THAT(budget.Reserve(1, late), StatusIs(absl::StatusCode::kDeadlineExceeded));
}

TEST(MemoryBudgetTest, ManyThreadsTogetherNeverHoldMoreThanAllAndAllComeToAnEnd) {
  constexpr std::size_t kCapacity = 1000;
  MemoryBudget budget(kCapacity);
  const Cancellation never(MonotonicNow() + kGiveUp);  // guards against a hang
  std::atomic<std::size_t> held{0};
  std::atomic<int> granted{0};
  const auto work = [&](std::uint64_t seed) {
    for (std::uint64_t step = 0; step < 300; ++step) {
      const auto bytes =
          static_cast<std::size_t>(static_cast<double>(kCapacity + 1) * RandomUnit(seed, 2 * step));
      if (RandomUnit(seed, 2 * step + 1) < 0.1) {
        // Some give up.
        const Cancellation soon(MonotonicNow() + absl::Microseconds(50));
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
