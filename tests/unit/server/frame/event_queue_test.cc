// The queue as tables: the words of agents, and whether the frame's thread may go on.
//
// Events:   need 2 hits (two parts must end the stage that hits end); 1.0 hits (of part 1's first
//           replica); pop, without waiting; take; cancel.
// Answers:  ready, or sleeps; pop and take return the events that had come, or the error.

#include "server/frame/event_queue.h"

#include <cstdint>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/event_table.h"
#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;

constexpr PartStage kCulls = PartStage::kSelectingOccluders;
constexpr PartStage kDrawsAll = PartStage::kRenderingVisible;  // without culling

const std::map<std::string, PartStage>& StagesByLastWord() {
  static const auto* const stages =
      new std::map<std::string, PartStage>{{"hits", PartStage::kSelectingOccluders},
                                           {"occluders", PartStage::kRenderingOccluders},
                                           {"done", PartStage::kRenderingVisible},
                                           {"end", PartStage::kDone}};
  return *stages;
}

std::string TextOf(const FrameEvent& event) {
  static const auto* const words = new std::map<AgentWord, std::string>{
      {AgentWord::kRayHits, "hits"},   {AgentWord::kPixels, "pixels"},
      {AgentWord::kFrameDone, "done"}, {AgentWord::kOccludersDone, "occluders"},
      {AgentWord::kEnd, "end"},        {AgentWord::kDamaged, "damaged"}};
  return absl::StrCat(event.said.from.part, ".", event.said.from.replica, " ",
                      event.said.status.ok() ? words->at(event.said.word) : "lost");
}

std::string TextOf(const std::deque<FrameEvent>& events) {
  return absl::StrJoin(events, ", ", [](std::string* out, const FrameEvent& event) {
    absl::StrAppend(out, TextOf(event));
  });
}

// A queue that is told and answers in words.
class Table {
 public:
  explicit Table(PartStage first_stage) : first_stage_(first_stage) {}

  std::string Tell(const std::string& event) {
    const std::vector<std::string> words = absl::StrSplit(event, ' ');
    if (words[0] == "pop") {
      const absl::StatusOr<std::deque<FrameEvent>> events =
          queue_.PopAll(base::MonotonicTime::InfinitePast(), cancellation_);
      return events.ok() ? TextOf(*events) : absl::StatusCodeToString(events.status().code());
    }
    if (words[0] == "take") {
      return TextOf(queue_.TakeAll());
    }
    if (words[0] == "cancel") {
      cancellation_.Cancel();
    } else if (words[0] == "need") {
      FrameProtocol::Awaited needed{.count = 0, .stage = StagesByLastWord().at(words[2])};
      EXPECT_TRUE(absl::SimpleAtoi(words[1], &needed.count)) << event;
      queue_.SetNeeded(needed);
    } else {
      Say(words[1], &ListenerOf(words[0]));
    }
    return queue_.is_ready() ? "ready" : "sleeps";
  }

 private:
  static void Say(const std::string& word, QueueingListener* listener) {
    if (word == "hits") {
      listener->OnRayHits({}, {});
    } else if (word == "pixels") {
      listener->OnPixels({});
    } else if (word == "occluders") {
      listener->OnOccludersDone();
    } else if (word == "done") {
      listener->OnFrameDone({});
    } else if (word == "end") {
      listener->OnEnd(absl::OkStatus());
    } else if (word == "lost") {
      listener->OnEnd(absl::UnavailableError("reset"));
    } else {
      ADD_FAILURE() << word;
    }
  }
  QueueingListener& ListenerOf(const std::string& name) {
    const std::vector<std::string> numbers = absl::StrSplit(name, '.');
    AttemptId id;
    EXPECT_TRUE(absl::SimpleAtoi(numbers[0], &id.part) && absl::SimpleAtoi(numbers[1], &id.replica))
        << name;
    return listeners_.try_emplace(name, id, first_stage_, &queue_, &gate_).first->second;
  }

  const PartStage first_stage_;
  base::Cancellation cancellation_;
  ReadGate gate_{1000};
  EventQueue queue_;
  std::map<std::string, QueueingListener> listeners_;
};

void Check(PartStage first_stage, absl::string_view rows) {
  Table table(first_stage);
  testing::CheckEvents(rows, [&](const std::string& event) { return table.Tell(event); });
}

TEST(EventQueueTest, AFrameSleepsUntilEveryPartMayHaveEndedTheStage) {
  Check(kCulls, R"(
      need 3 hits       -> sleeps
      0.0 hits          -> sleeps
      2.0 hits          -> sleeps
      pop               -> 0.0 hits, 2.0 hits
      need 1 hits       -> sleeps
      1.0 hits          -> ready
      pop               -> 1.0 hits
      need 3 occluders  -> sleeps
      0.0 occluders     -> sleeps
      1.0 occluders     -> sleeps
      2.0 occluders     -> ready
      pop               -> 0.0 occluders, 1.0 occluders, 2.0 occluders
      pop               -> )");
}

TEST(EventQueueTest, ASoleEventIsEnoughForANewFrame) {
  Check(kCulls, R"(
      0.0 hits  -> ready
      pop       -> 0.0 hits)");
}

TEST(EventQueueTest, PixelsAndErrorsWakeTheFrameAtOnce) {
  Check(kCulls, R"(
      need 3 hits  -> sleeps
      0.0 hits     -> sleeps
      0.0 pixels   -> ready
      pop          -> 0.0 hits, 0.0 pixels
      need 2 hits  -> sleeps
      1.0 lost     -> ready
      pop          -> 1.0 lost
      1.1 hits     -> sleeps
      2.0 lost     -> ready
      2.1 hits     -> ready
      pop          -> 1.1 hits, 2.0 lost, 2.1 hits)");
}

TEST(EventQueueTest, WordsOutOfOrderWakeTheFrameAtOnce) {
  Check(kCulls, R"(
      need 3 hits    -> sleeps
      0.0 done       -> ready
      pop            -> 0.0 done
      1.0 hits       -> sleeps
      1.0 hits       -> ready
      pop            -> 1.0 hits, 1.0 hits
      2.0 end        -> ready
      pop            -> 2.0 end)");
}

TEST(EventQueueTest, WordsOfAnotherStageThanTheAwaitedOneWakeTheFrameAtOnce) {
  Check(kCulls, R"(
      need 3 hits       -> sleeps
      0.0 hits          -> sleeps
      0.0 occluders     -> ready
      pop               -> 0.0 hits, 0.0 occluders
      need 2 hits       -> sleeps
      1.0 hits          -> sleeps
      need 2 occluders  -> ready
      pop               -> 1.0 hits
      need 2 occluders  -> sleeps)");
}

TEST(EventQueueTest, EventsThatWaitCountForTheNextNeed) {
  Check(kCulls, R"(
      need 3 hits  -> sleeps
      0.0 hits     -> sleeps
      1.0 hits     -> sleeps
      need 2 hits  -> ready)");
}

// It follows the last word at once, so the frame would wake twice for each agent.
TEST(EventQueueTest, TheEndOfAStreamThatIsDoneWakesNobodyByItself) {
  Check(kDrawsAll, R"(
      need 4 done  -> sleeps
      0.0 done     -> sleeps
      0.0 end      -> sleeps
      1.0 done     -> sleeps
      1.0 lost     -> ready
      pop          -> 0.0 done, 0.0 end, 1.0 done, 1.0 lost)");
}

TEST(EventQueueTest, ACancelledFrameLeavesItsEventsToBeTaken) {
  Check(kCulls, R"(
      need 2 hits  -> sleeps
      0.0 hits     -> sleeps
      cancel       -> sleeps
      pop          -> CANCELLED
      1.0 lost     -> ready
      pop          -> CANCELLED
      take         -> 0.0 hits, 1.0 lost
      take         -> )");
}

TEST(EventQueueTest, AWaitEndsAtTheDeadlineOrWithACancellation) {
  EventQueue queue;
  const base::Cancellation passes(base::MonotonicNow() + absl::Milliseconds(1));
  EXPECT_THAT(queue.PopAll(base::MonotonicTime::InfiniteFuture(), passes),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  base::Cancellation cancellation;
  absl::Status ended;
  std::thread frame(
      [&] { ended = queue.PopAll(base::MonotonicTime::InfiniteFuture(), cancellation).status(); });
  absl::SleepFor(absl::Milliseconds(5));  // most likely it sleeps by now
  cancellation.Cancel();
  frame.join();
  EXPECT_THAT(ended, StatusIs(absl::StatusCode::kCancelled));
}

TEST(EventQueueTest, EventsOfManyThreadsWakeTheFrameOnceAndKeepTheirOrder) {
  constexpr std::size_t kAgents = 8;
  constexpr std::size_t kEvents = 200;
  EventQueue queue;
  queue.SetNeeded({kAgents * kEvents, PartStage::kSelectingOccluders});
  std::vector<std::thread> agents;
  for (std::size_t part = 0; part < kAgents; ++part) {
    agents.emplace_back([&queue, part] {
      for (std::size_t i = 0; i < kEvents; ++i) {
        queue.Push({.said = {.from = {part, i}, .word = AgentWord::kRayHits, .arrival = {}},
                    .ended_stage = PartStage::kSelectingOccluders});
      }
    });
  }
  const absl::StatusOr<std::deque<FrameEvent>> events =
      queue.PopAll(base::MonotonicTime::InfiniteFuture(), base::Cancellation());
  for (std::thread& agent : agents) {
    agent.join();
  }
  ISOSCOPE_ASSERT_OK(events);
  EXPECT_EQ(events->size(), kAgents * kEvents);
  std::vector<std::size_t> counts(kAgents);
  for (const FrameEvent& event : *events) {
    EXPECT_EQ(event.said.from.replica, counts[event.said.from.part]++);
  }
}

// A lost word would let the frame wait for ever.
TEST(EventQueueTest, AnEventThatNoMemoryIsLeftForFailsTheFrame) {
  constexpr std::size_t kEvents = 100;
  EventQueue queue;
  queue.SetNeeded({kEvents, PartStage::kSelectingOccluders});
  std::vector<FrameEvent> events(kEvents);
  for (FrameEvent& event : events) {
    event.ended_stage = PartStage::kSelectingOccluders;
  }
  {
    const testing::MemoryFailure failure(1, testing::MemoryFailure::Mode::kOnce);
    for (FrameEvent& event : events) {
      queue.Push(std::move(event));
    }
    ASSERT_TRUE(failure.has_come());
  }
  EXPECT_TRUE(queue.is_ready());
  EXPECT_THAT(queue.PopAll(base::MonotonicTime::InfiniteFuture(), base::Cancellation()),
              StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(queue.TakeAll().size(), kEvents - 1);
}

TEST(QueueingListenerTest, EachWordBringsItsContent) {
  ReadGate gate(100);
  EventQueue queue;
  QueueingListener listener({3, 1}, PartStage::kSelectingOccluders, &queue, &gate);
  const base::MonotonicTime begin = base::MonotonicNow();
  listener.OnRayHits({5, 9}, {5, 7, 9});
  listener.OnPixels({"one", "two"});
  listener.OnDrawnPixels({.image = image::FrameImage(4, 3), .layers = {}, .memory = nullptr});
  frame::AgentStatistics statistics;
  statistics.triangle_count = 12;
  listener.OnFrameDone(statistics);
  listener.OnEnd(absl::DataLossError("block 7"));
  const std::deque<FrameEvent> events = queue.TakeAll();
  ASSERT_EQ(events.size(), 5U);
  EXPECT_THAT(std::get<RayHits>(events[0].content).hits, ElementsAre(5, 9));
  EXPECT_THAT(std::get<RayHits>(events[0].content).active, ElementsAre(5, 7, 9));
  EXPECT_THAT(std::get<Bands>(events[1].content).bands, ElementsAre("one", "two"));
  EXPECT_EQ(std::get<image::DrawnPixels>(events[2].content).image.width, 4);
  EXPECT_EQ(std::get<frame::AgentStatistics>(events[3].content).triangle_count, 12);
  EXPECT_THAT(events[4].said.status, StatusIs(absl::StatusCode::kDataLoss, "block 7"));
  for (const FrameEvent& event : events) {
    EXPECT_EQ(event.said.from, (AttemptId{3, 1}));
    EXPECT_GE(event.said.arrival, begin);
  }
}

TEST(QueueingListenerTest, BandsShutTheGateUntilTheyAreDropped) {
  ReadGate gate(5);
  EventQueue queue;
  QueueingListener listener({0, 0}, PartStage::kRenderingVisible, &queue, &gate);
  listener.OnPixels({"one", "two"});
  int reads = 0;
  listener.WhenRoom([&] { ++reads; });
  EXPECT_EQ(reads, 0);
  queue.TakeAll();
  EXPECT_EQ(reads, 1);
}

}  // namespace
}  // namespace isoscope::server
