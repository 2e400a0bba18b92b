#include "server/admission/admission.h"

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/retry_delay.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

AdmissionOptions Options(int max_working, int max_waiting) {
  return {.limits = {.max_working = max_working, .max_waiting = max_waiting}};
}

// As absl's, which ThreadSanitizer can't see.
class Notification {
 public:
  void Notify() {
    const base::MutexLock lock(&mutex_);
    has_come_ = true;
    change_.SignalAll();  // with the mutex held: whoever waits may destroy this
  }
  [[nodiscard]] bool HasBeenNotified() {
    const base::MutexLock lock(&mutex_);
    return has_come_;
  }
  bool WaitForNotificationWithTimeout(absl::Duration timeout) {
    const base::MutexLock lock(&mutex_);
    return change_.AwaitUntil(&mutex_, base::MonotonicNow() + timeout,
                              [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return has_come_; });
  }
  void WaitForNotification() { WaitForNotificationWithTimeout(absl::InfiniteDuration()); }

 private:
  base::Mutex mutex_;
  base::CondVar change_;
  bool has_come_ ABSL_GUARDED_BY(mutex_) = false;
};

// One frame: its place, and how its turn came.
struct Frame {
  std::optional<Admission::Place> place;
  Notification ended;
  absl::Status turn;
};

class AdmissionTest : public ::testing::Test {
 protected:
  void TearDown() override {
    if (!release_.HasBeenNotified()) {
      release_.Notify();
    }
    admission_.reset();  // while frames are there
  }

  void Start(int max_working, int max_waiting) {
    admission_ = std::make_unique<Admission>(Options(max_working, max_waiting));
  }

  // Schedules a frame that notes its name.
  Frame* Come(const std::string& client, const std::string& name,
              base::MonotonicTime deadline = base::MonotonicTime::InfiniteFuture()) {
    absl::StatusOr<Admission::Place> place = admission_->Admit(client);
    if (!place.ok()) {
      return nullptr;
    }
    frames_.push_back(std::make_unique<Frame>());
    Frame* const frame = frames_.back().get();
    frame->place.emplace(*std::move(place));
    admission_->Schedule(frame->place->ticket(), deadline,
                         [this, frame, name](const absl::Status& turn) {
                           {
                             const base::MutexLock lock(&mutex_);
                             if (turn.ok()) {
                               order_.push_back(name);
                             }
                           }
                           frame->turn = turn;
                           frame->place.reset();
                           frame->ended.Notify();
                         });
    return frame;
  }

  // Occupies one thread until release_.
  void Hold(const std::string& client) {
    absl::StatusOr<Admission::Place> place = admission_->Admit(client);
    ISOSCOPE_ASSERT_OK(place);
    const auto held = std::make_shared<Admission::Place>(*std::move(place));
    Notification begun;
    admission_->Schedule(held->ticket(), base::MonotonicTime::InfiniteFuture(),
                         [this, held, &begun](const absl::Status& turn) {
                           ISOSCOPE_EXPECT_OK(turn);
                           begun.Notify();
                           release_.WaitForNotification();
                         });
    begun.WaitForNotification();
  }

  std::vector<std::string> Order() {
    const base::MutexLock lock(&mutex_);
    return order_;
  }

  Notification release_;
  base::Mutex mutex_;
  std::vector<std::string> order_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::unique_ptr<Frame>> frames_;
  std::unique_ptr<Admission> admission_;
};

TEST_F(AdmissionTest, ClientsTakeTurns) {
  Start(1, 8);
  Hold("x");
  std::vector<Frame*> all;
  for (const char* name : {"a1", "a2", "a3"}) {
    all.push_back(Come("a", name));
  }
  all.push_back(Come("b", "b1"));
  EXPECT_EQ(admission_->counts().working, 1);
  EXPECT_EQ(admission_->counts().waiting, 4);
  EXPECT_EQ(admission_->counts().waiting_clients, 2);
  release_.Notify();
  for (Frame* frame : all) {
    frame->ended.WaitForNotification();
    ISOSCOPE_EXPECT_OK(frame->turn);
  }
  EXPECT_THAT(Order(), ElementsAre("a1", "b1", "a2", "a3"));
}

TEST_F(AdmissionTest, ARefusalSaysWhyAndWhenToComeAgain) {
  Start(1, 1);
  Hold("a");
  ASSERT_NE(Come("a", "a2"), nullptr);
  const absl::Status refused = admission_->Admit("b").status();
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted,
                                AllOf(HasSubstr("1 frames are in work and 1 wait, of 1 clients"),
                                      HasSubstr("--max-queued-frames"), HasSubstr("retry later"))));
  EXPECT_TRUE(base::RetryDelayOf(refused).has_value());
  EXPECT_EQ(admission_->counts().outside_clients, 1);
}

TEST_F(AdmissionTest, AFrameThatMakesRoomIsToldAtOnceWithoutItsTurn) {
  Start(1, 2);
  Hold("x");
  Come("a", "a1");
  Frame* const last = Come("a", "a2");
  ASSERT_NE(Come("b", "b1"), nullptr);
  last->ended.WaitForNotification();
  EXPECT_THAT(last->turn, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("made room")));
  EXPECT_TRUE(base::RetryDelayOf(last->turn).has_value());
}

TEST_F(AdmissionTest, ADeadlineThatPassesInTheLineEndsTheFrameWhileTheThreadsAreBusy) {
  Start(1, 4);
  Hold("x");
  Come("a", "a1");
  Frame* const late = Come("a", "a2", base::MonotonicNow() + absl::Milliseconds(30));
  late->ended.WaitForNotification();
  EXPECT_THAT(late->turn, StatusIs(absl::StatusCode::kDeadlineExceeded,
                                   AllOf(HasSubstr("waited"), HasSubstr(" ms for its turn"),
                                         HasSubstr("1 frames are in work and 1 wait"))));
  EXPECT_EQ(admission_->counts().waiting, 1);
}

TEST_F(AdmissionTest, AnEarlierDeadlineThatComesLaterIsNotMissed) {
  Start(1, 4);
  Hold("x");
  Come("a", "a1", base::MonotonicNow() + absl::Hours(1));
  Frame* const late = Come("b", "b1", base::MonotonicNow() + absl::Milliseconds(20));
  EXPECT_TRUE(late->ended.WaitForNotificationWithTimeout(absl::Seconds(60)));
}

TEST_F(AdmissionTest, ACancelledFrameLeavesTheLineAndItsPlaceIsFree) {
  Start(1, 1);
  Hold("x");
  Frame* const cancelled = Come("a", "a1");
  EXPECT_EQ(Come("a", "a2"), nullptr);
  admission_->Leave(frames_.front()->place->ticket());
  cancelled->ended.WaitForNotification();
  EXPECT_THAT(cancelled->turn, StatusIs(absl::StatusCode::kCancelled));
  EXPECT_NE(Come("a", "a3"), nullptr);
}

TEST_F(AdmissionTest, LeavingIsNothingToFramesInWorkAndToStrangers) {
  Start(1, 1);
  Hold("x");
  admission_->Leave(1);
  admission_->Leave(77);
  EXPECT_EQ(admission_->counts().working, 1);
}

TEST_F(AdmissionTest, WhoCancelsUnderALockOfTheWorkDoesNotRunIt) {
  Start(1, 2);
  Hold("x");
  Notification ended;
  base::Mutex of_work;
  absl::StatusOr<Admission::Place> place = admission_->Admit("a");
  ISOSCOPE_ASSERT_OK(place);
  admission_->Schedule(place->ticket(), base::MonotonicTime::InfiniteFuture(),
                       [&](const absl::Status&) {
                         { const base::MutexLock lock(&of_work); }
                         ended.Notify();
                       });
  {
    const base::MutexLock lock(&of_work);
    admission_->Leave(place->ticket());
  }
  ended.WaitForNotification();
}

TEST_F(AdmissionTest, TheEndTellsAllThatWait) {
  Start(1, 4);
  Hold("x");
  Frame* const first = Come("a", "a1");
  Frame* const second = Come("b", "b1");
  std::thread stop([&] { admission_.reset(); });
  first->ended.WaitForNotification();
  second->ended.WaitForNotification();
  EXPECT_THAT(first->turn, StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(second->turn, StatusIs(absl::StatusCode::kUnavailable));
  release_.Notify();
  stop.join();
}

TEST_F(AdmissionTest, WorkThatSchedulesMoreWhileAllStopsIsTold) {
  Start(1, 4);
  Notification begun;
  Notification told;
  absl::Status turn;
  Admission* const admission = admission_.get();
  auto first = admission->Admit("a");
  auto second = admission->Admit("a");
  ISOSCOPE_ASSERT_OK(first);
  ISOSCOPE_ASSERT_OK(second);
  const auto places = std::make_shared<std::vector<Admission::Place>>();
  const Admission::Ticket first_ticket = first->ticket();
  const Admission::Ticket next = second->ticket();
  places->push_back(*std::move(first));
  places->push_back(*std::move(second));
  admission->Schedule(first_ticket, base::MonotonicTime::InfiniteFuture(),
                      [&, places](const absl::Status&) {
                        begun.Notify();
                        release_.WaitForNotification();
                        admission->Schedule(next, base::MonotonicTime::InfiniteFuture(),
                                            [&, places](const absl::Status& its_turn) {
                                              turn = its_turn;
                                              places->clear();
                                              told.Notify();
                                            });
                      });
  begun.WaitForNotification();
  Frame* const waits = Come("a", "a3");
  std::thread stop([this] { admission_.reset(); });
  waits->ended.WaitForNotification();  // so it stops
  release_.Notify();
  told.WaitForNotification();
  EXPECT_THAT(turn, StatusIs(absl::StatusCode::kUnavailable));
  stop.join();
}

TEST_F(AdmissionTest, APlaceThatIsDroppedWhileItWaitsRunsNothing) {
  Start(1, 1);
  Hold("x");
  {
    auto place = admission_->Admit("a");
    ISOSCOPE_ASSERT_OK(place);
    admission_->Schedule(place->ticket(), base::MonotonicTime::InfiniteFuture(),
                         [](const absl::Status&) { FAIL() << "nobody waits for it"; });
  }
  EXPECT_EQ(admission_->counts().waiting, 0);
  EXPECT_NE(Come("a", "a1"), nullptr);
}

TEST_F(AdmissionTest, EveryFrameOfManyThreadsEndsExactlyOnce) {
  constexpr int kThreads = 8;
  constexpr int kFrames = 500;
  Start(3, 6);
  std::atomic<int> admitted{0};
  std::atomic<int> ended{0};
  std::atomic<int> done{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&, i] {
      for (int j = 0; j < kFrames; ++j) {
        absl::StatusOr<Admission::Place> place = admission_->Admit(absl::StrCat(i % 5));
        if (!place.ok()) {
          continue;
        }
        ++admitted;
        const Admission::Ticket ticket = place->ticket();
        const auto kept = std::make_shared<std::optional<Admission::Place>>(*std::move(place));
        admission_->Schedule(ticket,
                             j % 3 == 0 ? base::MonotonicNow() + absl::Microseconds(50)
                                        : base::MonotonicTime::InfiniteFuture(),
                             [&, kept](const absl::Status& turn) {
                               done += turn.ok() ? 1 : 0;
                               kept->reset();
                               ++ended;
                             });
        if (j % 7 == 0) {
          admission_->Leave(ticket);
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  while (ended.load() < admitted.load()) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  EXPECT_EQ(ended.load(), admitted.load());
  EXPECT_GT(done.load(), 0);
  EXPECT_EQ(admission_->counts().waiting, 0);
  EXPECT_EQ(admission_->counts().working, 0);
}

}  // namespace
}  // namespace isoscope::server
