// The protocol as tables: events, and the commands that each gives.
//
// Events:   begin; 1.0 hits (of part 1's first replica); step; watch 100ms (since the frame began);
//           unreachable 1.0; may hedge.
//           deadline 40ms, 1.0 hits, ... gives the error of a frame that failed after these events;
//           lost, 1.0 gone, ... its lost parts.
//           [step 2] stands for the events that bring two parts there.
//           report gives what the frame learnt of its agents.
// Commands: begin 1.0; cancel 1.0; reduce (this event's content); send occluders 1.0 (with "only",
//           if no other attempt may want them); step visible. An error ends the frame.

#include "server/frame/frame_protocol.h"

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "tests/support/event_table.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;

constexpr base::MonotonicTime kBegin = base::MonotonicTime();

struct Word {
  AgentWord word = AgentWord::kEnd;
  absl::Status status = absl::OkStatus();
};

const std::map<std::string, Word>& Words() {
  static const auto* const words = new std::map<std::string, Word>{
      {"hits", {AgentWord::kRayHits}},
      {"pixels", {AgentWord::kPixels}},
      {"occluders", {AgentWord::kOccludersDone}},
      {"done", {AgentWord::kFrameDone}},
      {"end", {AgentWord::kEnd}},
      {"damaged", {AgentWord::kDamaged, absl::DataLossError("pixels: checksum")}},
      {"gone", {AgentWord::kEnd, absl::UnavailableError("reset")}},
      {"torn", {AgentWord::kEnd, absl::DataLossError("block 7")}},
      {"other", {AgentWord::kEnd, absl::FailedPreconditionError("other content")}},
      {"bug", {AgentWord::kEnd, absl::InternalError("bug")}},
      {"busy",
       {AgentWord::kEnd,
        base::WithRetryDelay(absl::ResourceExhaustedError("busy"), absl::Seconds(3))}},
      {"cancelled", {AgentWord::kEnd, absl::CancelledError("by you")}},
      {"late", {AgentWord::kEnd, absl::DeadlineExceededError("mine")}},
  };
  return *words;
}

AttemptId IdOf(absl::string_view text) {
  const std::vector<std::string> numbers = absl::StrSplit(text, '.');
  AttemptId id;
  EXPECT_TRUE(absl::SimpleAtoi(numbers[0], &id.part) && absl::SimpleAtoi(numbers[1], &id.replica))
      << text;
  return id;
}

std::string StageName(PartStage stage) {
  return stage == PartStage::kRenderingOccluders ? "occluders"
         : stage == PartStage::kRenderingVisible ? "visible"
                                                 : "done";
}

// A protocol that is told and answers in words.
class Table {
 public:
  Table(std::vector<int> replica_counts, PartStage first_stage,
        base::MonotonicTime deadline = base::MonotonicTime::InfiniteFuture())
      : setup_{.replica_counts = std::move(replica_counts),
               .is_lost =
                   [this](int part, int replica) {
                     return unreachable_.contains(absl::StrCat(part, ".", replica));
                   },
               .may_hedge = [this](int /*part*/, int /*replica*/) { return may_hedge_; }},
        protocol_(setup_, first_stage, kBegin, deadline) {}

  // Returns what the event gives.
  std::string Tell(absl::string_view event) {
    const std::vector<absl::string_view> list = absl::StrSplit(event, ", ");
    const std::pair<std::string, std::string> words =
        absl::StrSplit(list[0], absl::MaxSplits(' ', 1));
    const auto& [first, rest] = words;
    if (first == "begin") {
      return Answer(protocol_.Begin());
    }
    if (first == "step") {
      return Answer(protocol_.BeginStep(next_step_));
    }
    if (first == "watch" || first == "deadline") {
      EXPECT_TRUE(absl::ParseDuration(rest, &now_));
      return first == "watch" ? Answer(protocol_.Watch(kBegin + now_, kBegin))
                              : MessageOf(protocol_.DeadlineError(LateEvents(list), kBegin + now_));
    }
    if (first == "unreachable") {
      unreachable_.insert(rest);
      return "";
    }
    if (first == "may") {
      may_hedge_ = true;
      return "";
    }
    if (first == "lost") {
      return protocol_.has_lost_part() ? absl::StrJoin(protocol_.LostParts(LateEvents(list)), " ")
                                       : "";
    }
    return first == "report" ? Report() : Answer(protocol_.Handle(EventOf(list[0])));
  }

  [[nodiscard]] const absl::Status& error() const { return error_; }
  [[nodiscard]] const FrameProtocol& protocol() const { return protocol_; }

 private:
  // Returns the frame's report on its agents.
  std::string Report() {
    const AgentReport report = protocol_.TakeReport();
    std::vector<std::string> texts;
    for (const AgentFailure& failure : report.failures) {
      EXPECT_THAT(failure.agent.shard_indices, ElementsAre(static_cast<int>(failure.part_index)));
      texts.push_back(absl::StrCat(failure.agent.address, " failed ", NameOf(failure.stage), ": ",
                                   failure.status.message()));
    }
    for (const AgentIdentity& agent : report.lost_hedges) {
      texts.push_back(absl::StrCat(agent.address, " outrun"));
    }
    if (report.hedge_count > 0) {
      texts.push_back(absl::StrCat(report.hedge_count, " hedged"));
    }
    return absl::StrJoin(texts, "; ");
  }
  AgentEvent EventOf(absl::string_view text) {
    const std::pair<std::string, std::string> words = absl::StrSplit(text, ' ');
    const auto found = Words().find(words.second);
    if (found == Words().end()) {
      ADD_FAILURE() << text;
      return {};
    }
    return {IdOf(words.first), found->second.word, kBegin + now_, found->second.status};
  }
  // Those behind the first word.
  std::vector<AgentEvent> LateEvents(const std::vector<absl::string_view>& list) {
    std::vector<AgentEvent> events;
    for (std::size_t i = 1; i < list.size(); ++i) {
      events.push_back(EventOf(list[i]));
    }
    return events;
  }
  static std::string MessageOf(const absl::Status& status) {
    return status.ToString(absl::StatusToStringMode::kWithNoExtraData);
  }

  std::string Answer(const absl::StatusOr<Commands>& commands) {
    if (!commands.ok()) {
      error_ = commands.status();
      return MessageOf(error_);
    }
    std::vector<std::string> texts;
    for (const Command& command : *commands) {
      const std::string id = absl::StrCat(command.attempt.part, ".", command.attempt.replica);
      switch (command.kind) {
        case Command::Kind::kBegin:
          protocol_.NoteBegun(command.attempt,
                              {absl::StrCat("a", id), {static_cast<int>(command.attempt.part)}},
                              kBegin + now_);
          texts.push_back(absl::StrCat("begin ", id));
          break;
        case Command::Kind::kCancel:
          texts.push_back(absl::StrCat("cancel ", id));
          break;
        case Command::Kind::kReduce:
          texts.emplace_back("reduce");
          break;
        case Command::Kind::kSend:
          texts.push_back(absl::StrCat("send ", StageName(command.stage), " ", id,
                                       command.is_only_attempt ? " only" : ""));
          break;
        case Command::Kind::kStep:
          next_step_ = command.stage;
          texts.push_back(absl::StrCat("step ", StageName(command.stage)));
          break;
      }
    }
    return absl::StrJoin(texts, ", ");
  }

  const ReplicaSetup setup_;
  std::set<std::string> unreachable_;
  bool may_hedge_ = false;
  FrameProtocol protocol_;
  PartStage next_step_ = PartStage::kSelectingOccluders;
  absl::Duration now_ = absl::ZeroDuration();  // since the frame began
  absl::Status error_;                         // that ended the frame
};

constexpr PartStage kCulls = PartStage::kSelectingOccluders;
constexpr PartStage kDrawsAll = PartStage::kRenderingVisible;  // without culling

// Returns the events that bring two parts to a step.
std::vector<std::string> Prelude(absl::string_view name) {
  std::vector<std::string> events = {"begin"};
  if (name != "[step 1]") {
    events.insert(events.end(), {"0.0 hits", "1.0 hits", "step"});
  }
  if (name == "[step 3]") {
    events.insert(events.end(), {"0.0 occluders", "1.0 occluders", "step"});
  }
  return events;
}

// Tells a new protocol the rows, and expects that its report has been read.
void Check(PartStage first_stage, const std::vector<int>& replica_counts, absl::string_view rows,
           base::MonotonicTime deadline = base::MonotonicTime::InfiniteFuture()) {
  Table table(replica_counts, first_stage, deadline);
  testing::CheckEvents(rows, [&](const std::string& event) {
    if (!absl::StartsWith(event, "[")) {
      return table.Tell(event);
    }
    for (const std::string& step : Prelude(event)) {
      table.Tell(step);
    }
    return std::string();
  });
  EXPECT_EQ(table.Tell("report"), "") << rows;
}

TEST(FrameProtocolTest, AStepBeginsWhenAllPartsAreThere) {
  Check(kCulls, {1, 1}, R"(
      begin          -> begin 0.0, begin 1.0
      0.0 hits       -> reduce
      1.0 hits       -> reduce, step occluders
      step           -> send occluders 0.0 only, send occluders 1.0 only
      0.0 pixels     -> reduce
      0.0 occluders  -> reduce
      1.0 pixels     -> reduce
      1.0 occluders  -> reduce, step visible
      step           -> send visible 0.0 only, send visible 1.0 only
      1.0 pixels     -> reduce
      1.0 done       -> reduce
      0.0 pixels     -> reduce
      1.0 end        ->
      0.0 done       -> reduce, step done
      step           ->
      0.0 end        -> )");
  Check(kDrawsAll, {1, 1}, R"(
      begin          -> begin 0.0, begin 1.0
      1.0 pixels     -> reduce
      1.0 done       -> reduce
      0.0 done       -> reduce, step done
      step           ->
      0.0 end        ->
      1.0 gone       -> )");  // lost after its last word: it has done its part
}

// A relay asks its own coordinator first.
TEST(FrameProtocolTest, AgentsMayFailBetweenTheEndOfAStepAndTheBeginOfTheNext) {
  Check(kCulls, {1, 2}, R"(
      [step 1]
      0.0 hits       -> reduce
      1.0 hits       -> reduce, step occluders
      1.0 gone       -> cancel 1.0, begin 1.1
      1.1 hits       ->
      step           -> send occluders 0.0 only, send occluders 1.1
      report         -> a1.0 failed rendering occluders: reset)");
}

TEST(FrameProtocolTest, ItAwaitsThePartsAtTheEarliestStage) {
  Table table({1, 1, 1}, kCulls);
  const auto awaited_after = [&](const std::vector<std::string>& events) {
    for (const std::string& event : events) {
      table.Tell(event);
    }
    const FrameProtocol::Awaited awaited = table.protocol().awaited();
    return absl::StrCat(awaited.count, " ", NameOf(awaited.stage));
  };
  EXPECT_EQ(awaited_after({"begin"}), "3 selecting occluders");
  EXPECT_EQ(awaited_after({"1.0 hits", "0.0 hits"}), "1 selecting occluders");
  EXPECT_EQ(awaited_after({"2.0 hits", "step", "1.0 occluders"}), "2 rendering occluders");
  EXPECT_EQ(awaited_after({"0.0 occluders", "2.0 occluders"}), "3 rendering visible blocks");
  EXPECT_EQ(awaited_after({"step", "1.0 done"}), "2 rendering visible blocks");
  EXPECT_EQ(awaited_after({"0.0 done", "2.0 done", "0.0 end"}), "2 done");
  EXPECT_EQ(awaited_after({"1.0 end", "2.0 end"}), "3 ended");
}

TEST(FrameProtocolTest, EveryMessageOutOfOrderIsAnErrorThatNamesTheAgent) {
  const std::map<std::string, std::string> names = {{"hits", "ray hits"},
                                                    {"pixels", "pixels"},
                                                    {"occluders", "the end of the occluders"},
                                                    {"done", "the end of the frame"},
                                                    {"end", "the end of the stream"}};
  const std::string done = "\n 1.0 pixels -> reduce\n 1.0 done -> reduce";
  const struct {
    std::vector<std::string> wrong;
    std::string before;
    PartStage first_stage;
    PartStage at;
  } cases[] = {
      {{"pixels", "occluders", "done", "end"}, "[step 1]", kCulls, PartStage::kSelectingOccluders},
      {{"hits", "done", "end"}, "[step 2]", kCulls, PartStage::kRenderingOccluders},
      {{"hits", "occluders", "end"}, "[step 3]", kCulls, PartStage::kRenderingVisible},
      {{"hits", "occluders", "end"}, "[step 1]", kDrawsAll, PartStage::kRenderingVisible},
      {{"hits", "pixels", "occluders", "done"}, "[step 3]" + done, kCulls, PartStage::kDone},
      {{"hits", "pixels", "occluders", "done"}, "[step 1]" + done, kDrawsAll, PartStage::kDone},
      // The agent does not wait for the other one.
      {{"pixels", "occluders"},
       "[step 1]\n 1.0 hits -> reduce",
       kCulls,
       PartStage::kRenderingOccluders},
      {{"pixels", "done"},
       "[step 2]\n 1.0 occluders -> reduce",
       kCulls,
       PartStage::kRenderingVisible},
  };
  for (const auto& [wrong, before, first_stage, at] : cases) {
    for (const std::string& word : wrong) {
      const std::string error =
          absl::StrCat("sent ", names.at(word), " out of order; its version may differ");
      Check(first_stage, {1, 1},
            absl::StrCat(before, "\n 1.0 ", word, " -> INTERNAL: agent a1.0 (shard 1): ", error,
                         "\n report -> a1.0 failed ", NameOf(at), ": ", error));
    }
  }
}

TEST(FrameProtocolTest, AnErrorOfAnAgentWithoutReplicaEndsTheFrame) {
  for (const auto& [step, stage] :
       std::map<std::string, std::string>{{"[step 1]", "selecting occluders"},
                                          {"[step 2]", "rendering occluders"},
                                          {"[step 3]", "rendering visible blocks"}}) {
    Check(kCulls, {1, 1},
          absl::StrCat(step, R"(
      1.0 torn       -> DATA_LOSS: agent a1.0 (shard 1): block 7
      lost           -> 1
      report         -> a1.0 failed )",
                       stage, ": block 7"));
  }
  // The same would happen to others, so nothing is lost.
  Check(kCulls, {1, 1}, R"(
      [step 1]
      1.0 busy       -> RESOURCE_EXHAUSTED: agent a1.0 (shard 1): busy
      lost           ->
      report         -> a1.0 failed selecting occluders: busy)");
}

// The new attempt begins at the first step. The frame stays where it is.
TEST(FrameProtocolTest, AnAgentLostAtAnyStepIsReplaced) {
  const std::string rest = R"(
      1.0 end        ->
      0.0 pixels     -> reduce
      0.0 done       -> reduce
      1.1 pixels     -> reduce
      1.1 done       -> reduce, step done
      1.1 end        ->
      0.0 end        -> )";
  for (const auto& [word, message] : std::map<std::string, std::string>{{"gone", "reset"},
                                                                        {"torn", "block 7"},
                                                                        {"other", "other content"},
                                                                        {"bug", "bug"},
                                                                        {"busy", "busy"}}) {
    const std::string lost = absl::StrCat("\n 1.0 ", word, " -> cancel 1.0, begin 1.1");
    Check(kCulls, {1, 2},
          absl::StrCat("[step 1]", lost, R"(
      0.0 hits       -> reduce
      1.1 hits       -> reduce, step occluders
      step           -> send occluders 0.0 only, send occluders 1.1
      0.0 occluders  -> reduce
      1.1 occluders  -> reduce, step visible
      step           -> send visible 0.0 only, send visible 1.1)",
                       rest, R"(
      report         -> a1.0 failed selecting occluders: )",
                       message));
    Check(kCulls, {1, 2},
          absl::StrCat("[step 1]\n 1.0 hits -> reduce", lost, R"(
      1.1 hits       ->
      0.0 hits       -> reduce, step occluders
      step           -> send occluders 0.0 only, send occluders 1.1
      1.1 occluders  -> reduce
      0.0 occluders  -> reduce, step visible
      step           -> send visible 0.0 only, send visible 1.1)",
                       rest, R"(
      report         -> a1.0 failed rendering occluders: )",
                       message));
    Check(kCulls, {1, 2},
          absl::StrCat("[step 2]\n 1.0 pixels -> reduce", lost, R"(
      1.1 hits       -> send occluders 1.1
      1.1 pixels     -> reduce
      1.1 occluders  -> reduce
      0.0 occluders  -> reduce, step visible
      step           -> send visible 0.0 only, send visible 1.1)",
                       rest, R"(
      report         -> a1.0 failed rendering occluders: )",
                       message));
    Check(kCulls, {1, 2},
          absl::StrCat("[step 3]\n 1.0 pixels -> reduce", lost, R"(
      1.1 hits       -> send occluders 1.1
      1.1 pixels     -> reduce
      1.1 occluders  -> send visible 1.1)",
                       rest, R"(
      report         -> a1.0 failed rendering visible blocks: )",
                       message));
  }
}

TEST(FrameProtocolTest, ReplicasAreTriedUntilOneDoesThePartOrTheLastFails) {
  Check(kCulls, {1, 3}, R"(
      [step 1]
      1.0 gone       -> cancel 1.0, begin 1.1
      1.1 hits       -> reduce
      1.1 gone       -> cancel 1.1, begin 1.2
      0.0 hits       -> reduce, step occluders
      1.2 hits       ->
      step           -> send occluders 0.0 only, send occluders 1.2
      1.2 gone       -> UNAVAILABLE: agent a1.2 (shard 1) was lost: reset
                        (the last of 3 agents that serve it)
      lost           -> 1
      report         -> a1.0 failed selecting occluders: reset;
                        a1.1 failed rendering occluders: reset;
                        a1.2 failed rendering occluders: reset)");
  Check(kCulls, {1, 2}, R"(
      [step 1]
      1.0 cancelled  -> CANCELLED: agent a1.0 (shard 1): by you
      lost           ->
      report         -> a1.0 failed selecting occluders: by you)");
}

TEST(FrameProtocolTest, WhenAllReplicasAreBusyTheErrorStillTellsWhenToRetry) {
  Table table({2}, kDrawsAll);
  table.Tell("begin");
  EXPECT_EQ(table.Tell("0.0 busy"), "cancel 0.0, begin 0.1");
  EXPECT_EQ(table.Tell("0.1 busy"),
            "RESOURCE_EXHAUSTED: agent a0.1 (shard 0): busy (the last of 2 agents that serve it)");
  EXPECT_EQ(base::RetryDelayOf(table.error()), absl::Seconds(3));
}

// Else a frame that goes on without what is lost begins again for each of a rack's agents. Part 2
// has another replica.
TEST(FrameProtocolTest, OfARackThatIsLostAllPartsAreToldAtOnce) {
  Check(kDrawsAll, {1, 1, 2, 1, 1, 1, 1}, R"(
      begin          -> begin 0.0, begin 1.0, begin 2.0, begin 3.0, begin 4.0, begin 5.0, begin 6.0
      unreachable 5.0 ->
      0.0 done       -> reduce
      0.0 gone       ->
      1.0 gone       -> UNAVAILABLE: agent a1.0 (shard 1) was lost: reset
      lost, 2.0 gone, 3.0 torn, 4.0 other, 6.0 busy -> 1 3 4 5
      report         -> a1.0 failed rendering visible blocks: reset;
                        a2.0 failed rendering visible blocks: reset;
                        a3.0 failed rendering visible blocks: block 7;
                        a4.0 failed rendering visible blocks: other content)");
}

TEST(FrameProtocolTest, DamagedPixelsFailAnAttemptAlsoAfterItWasDone) {
  const std::string repeated = R"(
      1.0 damaged    -> cancel 1.0, begin 1.1
      1.1 hits       -> send occluders 1.1
      1.1 occluders  -> send visible 1.1
      1.1 pixels     -> reduce
      1.1 done       -> reduce, step done
      step           ->
      1.1 end        -> )";
  Check(kCulls, {1, 2}, absl::StrCat("[step 3]\n 0.0 done -> reduce\n 0.0 end ->", repeated, R"(
      report         -> a1.0 failed rendering visible blocks: pixels: checksum)"));
  for (const std::string end : {"", "\n 1.0 end ->"}) {
    Check(kCulls, {1, 2},
          absl::StrCat(R"([step 3]
      0.0 done       -> reduce
      0.0 end        ->
      1.0 done       -> reduce, step done
      step           ->)",
                       end, repeated, R"(
      report         -> a1.0 failed done: pixels: checksum)"));
  }
  Check(kCulls, {1, 1}, R"(
      [step 3]
      1.0 done       -> reduce
      1.0 damaged    -> DATA_LOSS: agent a1.0 (shard 1): pixels: checksum
      report         -> a1.0 failed done: pixels: checksum)");
  Check(kCulls, {1, 3}, R"(
      [step 1]
      1.0 gone       -> cancel 1.0, begin 1.1
      1.0 damaged    ->
      report         -> a1.0 failed selecting occluders: reset)");
}

TEST(FrameProtocolTest, ALatePartIsTriedBesideItsAttempt) {
  Check(kDrawsAll, {1, 3}, R"(
      [step 1]
      watch 1ms      ->
      unreachable 1.0 ->
      watch 2ms      -> begin 1.1
      watch 3ms      ->
      1.0 pixels     -> reduce
      1.1 pixels     -> reduce
      1.1 done       -> reduce, cancel 1.0
      1.0 gone       ->
      watch 4ms      ->
      report         -> a1.0 outrun)");
  Check(kDrawsAll, {1, 2}, R"(
      [step 1]
      unreachable 1.0 ->
      watch 1ms      -> begin 1.1
      1.0 done       -> reduce, cancel 1.1
      0.0 done       -> reduce, step done)");  // the first one was not slower
  Check(kDrawsAll, {1, 3}, R"(
      [step 1]
      unreachable 1.0 ->
      watch 1ms      -> begin 1.1
      1.1 gone       -> cancel 1.1
      1.0 done       -> reduce
      report         -> a1.1 failed rendering visible blocks: reset)");
  // A quarter of its time to the deadline.
  Check(kDrawsAll, {1, 2}, R"(
      [step 1]
      watch 2s       ->
      watch 2001ms   -> begin 1.1
      watch 7s       -> )",
        kBegin + absl::Seconds(8));
}

TEST(FrameProtocolTest, ASlowPartIsHedgedOnceIfThatIsAllowed) {
  Check(kDrawsAll, {1, 2}, R"(
      [step 1]
      0.0 done       -> reduce
      watch 41ms     ->
      may hedge      ->
      watch 42ms     -> begin 1.1
      watch 500ms    ->
      1.1 done       -> reduce, cancel 1.0, step done
      report         -> a1.0 outrun; 1 hedged)");
  // 40 ms are never slow, nor is twice the time of the others.
  Check(kDrawsAll, {1, 2}, R"(
      [step 1]
      may hedge      ->
      watch 40ms     ->
      0.0 done       -> reduce
      watch 80ms     ->
      watch 81ms     -> begin 1.1
      report         -> 1 hedged)");
  // Most are not there yet.
  Check(kDrawsAll, {1, 2, 1}, R"(
      begin          -> begin 0.0, begin 1.0, begin 2.0
      may hedge      ->
      0.0 done       -> reduce
      watch 500ms    ->
      2.0 done       -> reduce
      watch 1001ms   -> begin 1.1
      report         -> 1 hedged)");
}

TEST(FrameProtocolTest, TheDeadlineNamesTheAgentsOfTheSlowestStageThatHadNotAnswered) {
  Check(kCulls, {1, 1}, R"(
      [step 1]
      deadline 40ms  -> DEADLINE_EXCEEDED: the frame's deadline passed after 40ms; not answered:
                        agent a0.0 (shard 0), agent a1.0 (shard 1)
      report         -> a0.0 failed selecting occluders: had not answered;
                        a1.0 failed selecting occluders: had not answered)");
  const std::string only_second = R"( -> DEADLINE_EXCEEDED:
                        the frame's deadline passed after 40ms; not answered: agent a1.0 (shard 1)
      report         -> a1.0 failed )";
  // Events that had come count as answers.
  Check(kCulls, {1, 1},
        absl::StrCat("[step 1]\n deadline 40ms, 0.0 hits", only_second,
                     "selecting occluders: had not answered"));
  Check(kCulls, {1, 1},
        absl::StrCat("[step 3]\n deadline 40ms, 0.0 done, 0.0 end", only_second,
                     "rendering visible blocks: had not answered"));
  // An agent's own deadline.
  Check(kCulls, {1, 1},
        absl::StrCat(R"([step 2]
      0.0 occluders  -> reduce
      1.0 late       -> DEADLINE_EXCEEDED: mine
      deadline 40ms)",
                     only_second, "rendering occluders: had not answered"));
  Check(kCulls, {1, 2}, R"(
      [step 1]
      unreachable 1.0 ->
      watch 1ms      -> begin 1.1
      0.0 hits       -> reduce
      deadline 40ms  -> DEADLINE_EXCEEDED: the frame's deadline passed after 40ms; not answered:
                        agent a1.0 (shard 1), agent a1.1 (shard 1)
      report         -> a1.0 failed selecting occluders: had not answered;
                        a1.1 failed selecting occluders: had not answered)");
}

}  // namespace
}  // namespace isoscope::server
