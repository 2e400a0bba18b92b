#include "server/admission/admission_queue.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/random.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Ticket = AdmissionQueue::Ticket;

const base::MonotonicTime kStart = base::MonotonicTime() + absl::Seconds(1'000'000);

// A queue whose frames are known by names.
class AdmissionQueueTest : public ::testing::Test {
 protected:
  void Start(int max_working, int max_waiting) {
    queue_.emplace(AdmissionLimits{.max_working = max_working, .max_waiting = max_waiting});
  }

  // Admits a frame and lets it wait; what that meant: "", "refused", or the frame that made room.
  std::string Come(const std::string& client, const std::string& name,
                   base::MonotonicTime deadline = base::MonotonicTime::InfiniteFuture()) {
    const AdmissionQueue::Answer answer = queue_->Admit(client, now_);
    delay_ = answer.retry_delay;
    if (!answer.ticket.has_value()) {
      return "refused";
    }
    names_[*answer.ticket] = name;
    queue_->Join(*answer.ticket, deadline);
    return answer.evicted.has_value() ? names_[*answer.evicted] : "";
  }

  Ticket TicketOf(const std::string& name) const {
    for (const auto& [ticket, its_name] : names_) {
      if (its_name == name) {
        return ticket;
      }
    }
    return 0;
  }

  // Works on one frame after the other until none waits.
  std::vector<std::string> Drain() {
    std::vector<std::string> order;
    while (const auto ticket = queue_->TakeNext(now_)) {
      order.push_back(names_[*ticket]);
      queue_->End(*ticket, now_);
    }
    return order;
  }

  std::optional<AdmissionQueue> queue_;
  base::MonotonicTime now_ = kStart;
  absl::Duration delay_;
  std::map<Ticket, std::string> names_;
};

TEST_F(AdmissionQueueTest, FramesOfOneClientAreTakenInTheirOrder) {
  Start(1, 8);
  for (const char* name : {"a1", "a2", "a3"}) {
    EXPECT_EQ(Come("a", name), "");
  }
  EXPECT_THAT(Drain(), ElementsAre("a1", "a2", "a3"));
}

TEST_F(AdmissionQueueTest, ClientsTakeTurnsSoAGreedyOneHoldsNobodyUp) {
  Start(1, 16);
  for (const char* name : {"a1", "a2", "a3", "a4", "a5"}) {
    Come("a", name);
  }
  Come("b", "b1");
  Come("b", "b2");
  Come("c", "c1");
  EXPECT_EQ(queue_->waiting_client_count(), 3);
  EXPECT_THAT(Drain(), ElementsAre("a1", "b1", "c1", "a2", "b2", "a3", "a4", "a5"));
  EXPECT_EQ(queue_->waiting_client_count(), 0);
}

TEST_F(AdmissionQueueTest, AClientThatComesWhileOthersWaitGoesToTheEndOfTheLine) {
  Start(1, 16);
  Come("a", "a1");
  Come("a", "a2");
  Come("b", "b1");
  EXPECT_EQ(names_[*queue_->TakeNext(now_)], "a1");  // and a goes behind b
  Come("c", "c1");
  EXPECT_THAT(Drain(), ElementsAre("b1", "a2", "c1"));
}

TEST_F(AdmissionQueueTest, FramesInWorkTakePlacesAndGiveThemBack) {
  Start(2, 1);
  Come("a", "a1");
  Come("a", "a2");
  const Ticket first = *queue_->TakeNext(now_);
  EXPECT_EQ(queue_->working_count(), 1);
  EXPECT_EQ(Come("a", "a3"), "");
  EXPECT_EQ(Come("a", "a4"), "refused");
  queue_->End(first, now_);
  EXPECT_EQ(queue_->working_count(), 0);
  EXPECT_EQ(Come("a", "a5"), "");
  queue_->End(first, now_);  // once is enough
  EXPECT_EQ(Come("a", "a6"), "refused");
}

TEST_F(AdmissionQueueTest, TheNewestFrameOfTheLongestQueueMakesRoomForAClientWithFewer) {
  Start(1, 3);
  for (const char* name : {"a1", "a2", "a3"}) {
    Come("a", name);
  }
  Come("b", "b1");
  EXPECT_EQ(Come("a", "a4"), "refused") << "its own queue is the longest";
  EXPECT_EQ(Come("c", "c1"), "a3");
  EXPECT_GE(delay_, AdmissionQueue::kMinRetryDelay);
  EXPECT_EQ(Come("b", "b2"), "refused") << "one fewer than a is not enough to take turns over";
  EXPECT_THAT(Drain(), ElementsAre("a1", "b1", "c1", "a2"));
}

TEST_F(AdmissionQueueTest, FramesThatAreInWorkNeverMakeRoom) {
  Start(2, 0);
  Come("a", "a1");
  Come("a", "a2");
  queue_->TakeNext(now_);
  queue_->TakeNext(now_);
  EXPECT_EQ(Come("b", "b1"), "refused");
  EXPECT_EQ(queue_->working_count(), 2);
}

TEST_F(AdmissionQueueTest, ARefusedClientKeepsItsTurnAndTakesThePlaceOfOneThatCameLater) {
  Start(1, 1);
  Come("a", "a1");
  Come("b", "b1");
  EXPECT_EQ(Come("c", "c1"), "refused");
  EXPECT_EQ(queue_->outside_count(), 1);
  queue_->End(*queue_->TakeNext(now_), now_);  // a1; a comes again at once
  EXPECT_EQ(Come("a", "a2"), "");
  EXPECT_EQ(Come("c", "c1"), "a2") << "c came before a came again";
  EXPECT_EQ(Come("d", "d1"), "refused") << "nobody in the line came after d";
  EXPECT_THAT(Drain(), ElementsAre("b1", "c1"));
}

TEST_F(AdmissionQueueTest, ARefusedClientThatStaysAwayForLongLosesItsTurn) {
  Start(1, 1);
  Come("a", "a1");
  Come("b", "b1");
  EXPECT_EQ(Come("c", "c1"), "refused");
  queue_->End(*queue_->TakeNext(now_), now_);
  Come("a", "a2");
  now_ += 2 * delay_ + absl::Seconds(2);
  EXPECT_EQ(Come("c", "c1"), "refused");
  EXPECT_EQ(queue_->outside_count(), 1);
}

TEST_F(AdmissionQueueTest, WithMoreClientsThanPlacesThatComeAsToldAllAreServedAlike) {
  constexpr int kClients = 64;
  constexpr absl::Duration kFrame = absl::Milliseconds(20);
  Start(4, 32);
  std::vector<base::MonotonicTime> comes(kClients, kStart);
  std::vector<int> served(kClients, 0);
  int refusals = 0;
  std::vector<Ticket> in_work;
  // One step is the time in which four threads draw four frames.
  for (int step = 0; step < 4000; ++step, now_ += kFrame) {
    for (const Ticket ticket : in_work) {
      const int client = std::stoi(names_[ticket]);
      ++served[static_cast<std::size_t>(client)];
      comes[static_cast<std::size_t>(client)] = now_;
      queue_->End(ticket, now_);
    }
    in_work.clear();
    for (int client = 0; client < kClients; ++client) {
      base::MonotonicTime& come = comes[static_cast<std::size_t>(client)];
      if (come > now_) {
        continue;
      }
      const std::string room = Come(absl::StrCat("client ", client), absl::StrCat(client));
      come = room == "refused" ? now_ + delay_ : base::MonotonicTime::InfiniteFuture();
      refusals += room.empty() ? 0 : 1;
      if (room != "refused" && !room.empty()) {
        comes[static_cast<std::size_t>(std::stoi(room))] = now_ + delay_;
      }
    }
    while (in_work.size() < 4) {
      const auto ticket = queue_->TakeNext(now_);
      ASSERT_TRUE(ticket.has_value()) << "a thread has nothing to do, step " << step;
      in_work.push_back(*ticket);
    }
  }
  const auto [least, most] = std::minmax_element(served.begin(), served.end());
  EXPECT_LE(*most - *least, *most / 10) << *least << " to " << *most;
  EXPECT_LE(refusals, 2 * 4 * 4000) << "not more than two for each frame";
}

TEST_F(AdmissionQueueTest, DeadlinesThatHavePassedLeaveAtOnceWhereverTheyWait) {
  Start(1, 8);
  Come("a", "a1", now_ + absl::Seconds(9));
  Come("a", "a2", now_ + absl::Seconds(2));
  Come("b", "b1", now_ + absl::Seconds(1));
  EXPECT_EQ(queue_->next_deadline(), kStart + absl::Seconds(1));
  EXPECT_THAT(queue_->Expire(now_ + absl::Seconds(1)), IsEmpty()) << "the deadline itself counts";
  EXPECT_THAT(queue_->Expire(now_ + absl::Seconds(3)), ElementsAre(TicketOf("b1"), TicketOf("a2")));
  EXPECT_EQ(queue_->next_deadline(), kStart + absl::Seconds(9));
  EXPECT_THAT(Drain(), ElementsAre("a1"));
  EXPECT_EQ(queue_->next_deadline(), base::MonotonicTime::InfiniteFuture());
}

TEST_F(AdmissionQueueTest, WhoLeavesGivesItsPlaceBack) {
  Start(1, 1);
  Come("a", "a1");
  Come("a", "a2");
  EXPECT_TRUE(queue_->Leave(TicketOf("a2")));
  EXPECT_FALSE(queue_->Leave(TicketOf("a2")));
  EXPECT_EQ(Come("a", "a3"), "");
  const Ticket working = *queue_->TakeNext(now_);
  EXPECT_FALSE(queue_->Leave(working)) << "it does not wait";
  EXPECT_FALSE(queue_->Leave(12345));
}

TEST_F(AdmissionQueueTest, ToldTimesGrowWithTheLineAndWithTheDurationOfFrames) {
  const auto told = [&](int waiting, absl::Duration duration) {
    Start(2, waiting);
    Come("a", "a0");
    const Ticket ticket = *queue_->TakeNext(now_);
    queue_->End(ticket, now_ + duration);
    for (int i = 0; i < waiting + 2; ++i) {
      Come(absl::StrCat("b", i), "b");
    }
    EXPECT_EQ(Come("c", "c"), "refused");
    return delay_;
  };
  // 21 are ahead, half of them, two at a time, spread by a quarter.
  const absl::Duration tens = told(18, absl::Milliseconds(100));
  EXPECT_GE(tens, absl::Milliseconds(100) * (21.0 / 4 * 0.75));
  EXPECT_LE(tens, absl::Milliseconds(100) * (21.0 / 4 * 1.25));
  EXPECT_GT(told(98, absl::Milliseconds(100)), 2 * tens);
  EXPECT_GT(told(18, absl::Seconds(1)), 5 * tens);
  EXPECT_EQ(told(1000, absl::Hours(1)), AdmissionQueue::kMaxRetryDelay);
  EXPECT_EQ(told(1, absl::ZeroDuration()), AdmissionQueue::kMinRetryDelay);
}

TEST_F(AdmissionQueueTest, ClientsThatAreRefusedTogetherDoNotComeBackTogether) {
  Start(1, 0);
  Come("a", "a1");
  std::set<absl::Duration> delays;
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(Come(absl::StrCat("b", i), ""), "refused");
    delays.insert(delay_);
  }
  EXPECT_GE(delays.size(), 15u);
}

// Random events against the rules that hold at any time.
TEST_F(AdmissionQueueTest, AnyOrderOfEventsKeepsItsCounts) {
  std::uint64_t draws = 0;
  const auto draw = [&](std::uint64_t below) { return base::RandomBits(7, ++draws) % below; };
  Start(3, 9);
  std::vector<Ticket> admitted;
  std::vector<Ticket> working;
  std::set<Ticket> waiting;
  for (int i = 0; i < 200'000; ++i) {
    now_ += absl::Milliseconds(1);
    switch (draw(5)) {
      case 0:
      case 1: {
        const auto answer = queue_->Admit(absl::StrCat(draw(30)), now_);
        if (answer.evicted.has_value()) {
          ASSERT_EQ(waiting.erase(*answer.evicted), 1u);
        }
        if (answer.ticket.has_value()) {
          const Ticket ticket = *answer.ticket;
          if (draw(8) == 0) {
            admitted.push_back(ticket);
          } else {
            queue_->Join(ticket, now_ + absl::Milliseconds(static_cast<int>(draw(200))));
            waiting.insert(ticket);
          }
        } else {
          ASSERT_EQ(admitted.size() + working.size() + waiting.size(), 12u);
        }
        break;
      }
      case 2:
        if (working.size() < 3) {
          const auto ticket = queue_->TakeNext(now_);
          ASSERT_EQ(ticket.has_value(), !waiting.empty());
          if (ticket.has_value()) {
            ASSERT_EQ(waiting.erase(*ticket), 1u);
            working.push_back(*ticket);
          }
        }
        break;
      case 3:
        for (std::vector<Ticket>* tickets : {&admitted, &working}) {
          if (!tickets->empty()) {
            queue_->End(tickets->back(), now_);
            tickets->pop_back();
          }
        }
        break;
      default:
        if (!waiting.empty() && draw(2) == 0) {
          ASSERT_TRUE(queue_->Leave(*waiting.begin()));
          waiting.erase(waiting.begin());
        }
        for (const Ticket ticket : queue_->Expire(now_)) {
          ASSERT_EQ(waiting.erase(ticket), 1u);
        }
    }
    ASSERT_EQ(queue_->waiting_count(), static_cast<int>(waiting.size()));
    ASSERT_EQ(queue_->working_count(), static_cast<int>(working.size()));
  }
}

TEST_F(AdmissionQueueTest, ClientsThatNeverComeAgainAreForgotten) {
  Start(1, 0);
  Come("a", "a1");
  for (int i = 0; i < 5000; ++i) {
    Come(absl::StrCat("b", i), "");
  }
  EXPECT_LE(queue_->outside_count(), static_cast<int>(AdmissionQueue::kMaxOutside));
  now_ += absl::Hours(1);
  Come("c", "");
  EXPECT_EQ(queue_->outside_count(), 1);
}

}  // namespace
}  // namespace isoscope::server
