// The outbox as tables: answers that come, and those that are written.
//
// Events:   begin 3 (a moving frame of state 3), or begin exact 3; moving 3 (its frame has come),
//           exact 3, error 3, exact error 3: these begin it if it has not begun; write; written;
//           shown 2 (the second message); close.
//           under way gives the frames that hold a credit of the schedule, held the bytes of
//           memory.
// Answers:  write returns the message, or "nothing"; shown says whether it was an unshown moving
//           frame; begin exact says "later" if the schedule lets it wait.

#include "server/interact/interact_outbox.h"

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "tests/support/event_table.h"

namespace isoscope::server {
namespace {

constexpr std::size_t kAnswerBytes = 10;

// An outbox that is told and answers in words.
class Table {
 public:
  Table() { schedule_.SetCredits(InteractiveSchedule::kMaxCredits); }

  std::string Tell(const std::string& event) {
    if (event == "write") {
      return TextOf(outbox_.BeginWrite(now_));
    }
    if (event == "written") {
      outbox_.EndWrite();
      return "";
    }
    if (event == "close") {
      outbox_.Close();
      return "";
    }
    if (event == "under way") {
      return absl::StrCat(schedule_.under_way_count());
    }
    if (event == "held") {
      return absl::StrCat(budget_.reserved_bytes());
    }
    const std::vector<std::string> words = absl::StrSplit(event, ' ');
    std::int64_t number = 0;
    EXPECT_TRUE(absl::SimpleAtoi(words.back(), &number)) << event;
    if (words[0] == "shown") {
      schedule_.OnShown(number, now_);
      const bool was_unshown = outbox_.IsUnshownMoving(number);
      EXPECT_EQ(outbox_.NoteShown(number), was_unshown);
      EXPECT_FALSE(outbox_.IsUnshownMoving(number));
      return was_unshown ? "moving" : "other";
    }
    const bool is_begin = words[0] == "begin";
    const std::string& kind = words[is_begin ? 1 : 0];
    const std::string begun = Begin(number, /*is_exact=*/kind == "exact");
    if (!is_begin) {
      Push(number, /*is_error=*/words[words.size() - 2] == "error", kind == "exact");
    }
    return begun;
  }

 private:
  std::string Begin(std::int64_t state, bool is_exact) {
    if (works_.contains({state, is_exact})) {
      return "";
    }
    if (works_.contains({state, false})) {
      now_ += InteractiveSchedule::kRestDelay;
    } else {
      schedule_.OnState(state, /*is_at_rest=*/is_exact, now_);
    }
    const InteractiveSchedule::Step step = schedule_.Next(now_);
    if (!step.start.has_value()) {
      return "later";
    }
    EXPECT_EQ(step.start->is_exact, is_exact);
    works_[{state, is_exact}] = step.start->work;
    schedule_.OnDrawn(step.start->work);
    return "";
  }
  void Push(std::int64_t state, bool is_error, bool is_exact) {
    schedule_.OnWorkEnded(works_.at({state, is_exact}), /*has_answer=*/true, now_);
    InteractAnswer answer{.is_of_exact_work = is_exact};
    answer.message.set_sequence_number(state);
    answer.message.set_is_exact(is_exact);
    answer.message.mutable_frame();
    if (is_error) {
      answer.SetError(absl::NotFoundError("no such dataset"));
    }
    answer.memory.emplace(*budget_.Reserve(kAnswerBytes, base::Cancellation()));
    outbox_.Push(std::move(answer), now_);
    now_ += is_error ? InteractiveSchedule::kErrorPause : absl::ZeroDuration();
  }
  std::string TextOf(const isoscope::v1::InteractResponse* message) {
    if (message == nullptr) {
      return "nothing";
    }
    EXPECT_EQ(message->frame_number(), outbox_.sent_count());
    EXPECT_TRUE(outbox_.is_writing());
    const std::string kind = message->has_error()
                                 ? absl::StrCat("error ", message->error().code(), ": ",
                                                message->error().message(), ", state")
                             : message->is_exact() ? "exact"
                                                   : "moving";
    return absl::StrCat(kind, " ", message->sequence_number(), " as ", message->frame_number());
  }

  base::MonotonicTime now_ = base::MonotonicTime();
  base::MemoryBudget budget_{1000};
  InteractiveSchedule schedule_;
  InteractOutbox outbox_{&schedule_};
  std::map<std::pair<std::int64_t, bool>, std::int64_t>
      works_;  // by state, and whether it is exact
};

void Check(absl::string_view rows) {
  Table table;
  testing::CheckEvents(rows, [&](const std::string& event) { return table.Tell(event); });
}

TEST(InteractOutboxTest, OneAnswerIsWrittenAtATime) {
  Check(R"(
      write      -> nothing
      moving 1   ->
      write      -> moving 1 as 1
      moving 2   ->
      write      -> nothing
      written    ->
      write      -> moving 2 as 2
      written    ->
      write      -> nothing
      under way  -> 2
      shown 1    -> moving
      under way  -> 1
      shown 1    -> other)");
}

TEST(InteractOutboxTest, ANewerAnswerReplacesAWaitingOneOfItsKind) {
  Check(R"(
      moving 1   ->
      error 2    ->
      moving 3   ->
      under way  -> 2
      error 4    ->
      under way  -> 2
      write      -> moving 3 as 1
      written    ->
      write      -> error 5: no such dataset, state 4 as 2
      written    ->
      write      -> nothing)");
}

TEST(InteractOutboxTest, NoFrameIsOlderThanOneBeforeIt) {
  Check(R"(
      begin moving 1  ->
      moving 2        ->
      moving 1        ->
      under way       -> 1
      write           -> moving 2 as 1
      written         ->
      write           -> nothing
      exact 2         ->
      write           -> exact 2 as 2
      written         ->
      begin moving 3  ->
      moving 4        ->
      write           -> moving 4 as 3
      moving 3        ->
      written         ->
      write           -> nothing
      under way       -> 3)");
}

TEST(InteractOutboxTest, AnErrorIsNotDroppedForItsAge) {
  Check(R"(
      begin moving 1  ->
      moving 2        ->
      error 1         ->
      write           -> moving 2 as 1
      written         ->
      write           -> error 5: no such dataset, state 1 as 2)");
}

// A page makes its picture smaller for TOO_LARGE alone, and asks again after the time.
TEST(InteractOutboxTest, AnErrorHasTheReasonAndTheTimeThatOtherCallsHave) {
  InteractAnswer busy;
  busy.message.mutable_frame()->set_png("picture");
  busy.SetError(base::WithRetryDelay(absl::ResourceExhaustedError("full"), absl::Seconds(1.5)));
  EXPECT_FALSE(busy.message.has_frame());
  EXPECT_EQ(busy.message.error().reason(), "TOO_BUSY");
  EXPECT_EQ(busy.message.error().retry_duration().seconds(), 1);
  EXPECT_EQ(busy.message.error().retry_duration().nanos(), 500'000'000);
  InteractAnswer large;
  large.SetError(absl::ResourceExhaustedError("never fits"));
  EXPECT_EQ(large.message.error().reason(), "TOO_LARGE");
  EXPECT_FALSE(large.message.error().has_retry_duration());
  InteractAnswer stops;
  stops.SetError(
      base::WithReason(absl::UnavailableError("draining"), base::ErrorReason::kServerStops));
  EXPECT_EQ(stops.message.error().reason(), "SERVER_STOPS");
}

// The client shows nothing for an error, and acknowledges nothing.
TEST(InteractOutboxTest, AnErrorHoldsNoCreditOnceItIsSent) {
  Check(R"(
      error 1    ->
      under way  -> 1
      write      -> error 5: no such dataset, state 1 as 1
      under way  -> 0
      shown 1    -> other)");
}

TEST(InteractOutboxTest, AnExactFrameWaitsForTheOneBeforeUntilThatIsSentOrReplaced) {
  Check(R"(
      exact 1        ->
      begin exact 2  -> later
      write          -> exact 1 as 1
      begin exact 2  ->
      shown 1        -> other)");
  Check(R"(
      exact error 1  ->
      begin exact 2  -> later
      write          -> error 5: no such dataset, state 1 as 1
      begin exact 2  ->)");
  Check(R"(
      exact 1        ->
      begin exact 2  -> later
      moving 3       ->
      begin exact 4  ->)");
}

TEST(InteractOutboxTest, NothingIsWrittenAfterItIsClosed) {
  Check(R"(
      moving 1   ->
      write      -> moving 1 as 1
      moving 2   ->
      error 3    ->
      close      ->
      written    ->
      write      -> nothing
      moving 4   ->
      error 5    ->
      write      -> nothing
      held       -> 0)");
}

TEST(InteractOutboxTest, AnAnswerHoldsItsMemoryUntilItIsWrittenOrDropped) {
  Check(R"(
      moving 1        ->
      held            -> 10
      moving 2        ->
      held            -> 10
      write           -> moving 2 as 1
      held            -> 10
      begin moving 3  ->
      moving 4        ->
      moving 3        ->
      error 5         ->
      held            -> 30
      written         ->
      held            -> 20
      close           ->
      held            -> 0)");
}

// A client may show frames and never say so.
TEST(InteractOutboxTest, OnlyTheLastThousandUnshownFramesAreKept) {
  InteractiveSchedule schedule;
  InteractOutbox outbox(&schedule);
  for (int i = 1; i <= 1001; ++i) {
    InteractAnswer answer;
    answer.message.set_sequence_number(i);
    answer.message.mutable_frame();
    outbox.Push(std::move(answer), base::MonotonicTime());
    ASSERT_NE(outbox.BeginWrite(base::MonotonicTime()), nullptr);
    outbox.EndWrite();
  }
  EXPECT_FALSE(outbox.IsUnshownMoving(1));
  EXPECT_TRUE(outbox.IsUnshownMoving(2));
  EXPECT_TRUE(outbox.IsUnshownMoving(1001));
}

// A view that refines, whose exact frame comes in parts.
class PartsTest : public ::testing::Test {
 protected:
  // Begins and ends a part, and pushes its answer.
  void Push(bool is_tile, bool is_deferral = false) {
    const InteractiveSchedule::Step step = schedule_.Next(now_);
    ASSERT_TRUE(step.start.has_value());
    schedule_.OnWorkEnded(step.start->work, /*has_answer=*/true, now_);
    InteractAnswer answer{.is_of_exact_work = true, .is_part = is_tile || is_deferral};
    answer.message.set_sequence_number(1);
    if (is_tile) {
      answer.message.mutable_tile()->set_png("tile");
    } else if (is_deferral) {
      answer.message.mutable_exact_deferred();
    } else {
      answer.message.mutable_frame();
      answer.message.set_is_exact(true);
    }
    outbox_.Push(std::move(answer), now_);
    schedule_.ContinueExact();
  }

  const base::MonotonicTime now_ = base::MonotonicTime();
  InteractiveSchedule schedule_;
  InteractOutbox outbox_{&schedule_};
};

TEST_F(PartsTest, TilesAreSentInTheirOrderBeforeTheirFrame) {
  schedule_.OnState(1, true, now_, /*refines=*/true);
  Push(/*is_tile=*/true);
  ASSERT_NE(outbox_.BeginWrite(now_), nullptr);
  Push(/*is_tile=*/true);
  EXPECT_FALSE(schedule_.Next(now_).start.has_value()) << "one waits: the client is behind";
  outbox_.EndWrite();
  EXPECT_TRUE(outbox_.BeginWrite(now_)->has_tile());
  Push(/*is_tile=*/false);
  outbox_.EndWrite();
  EXPECT_TRUE(outbox_.BeginWrite(now_)->is_exact());
  EXPECT_EQ(outbox_.sent_count(), 3);
  EXPECT_FALSE(outbox_.IsUnshownMoving(1)) << "its delay tells nothing about moving frames";
}

TEST_F(PartsTest, AnotherPictureDropsTilesThatWait) {
  schedule_.OnState(1, true, now_, /*refines=*/true);
  Push(/*is_tile=*/true);
  outbox_.DropParts();
  EXPECT_EQ(outbox_.BeginWrite(now_), nullptr);
  EXPECT_EQ(schedule_.under_way_count(), 0);
  EXPECT_TRUE(schedule_.Next(now_).start.has_value()) << "nothing waits";
}

TEST_F(PartsTest, ADeferralNeedsNoAcknowledgementAndPausesNothing) {
  schedule_.OnState(1, true, now_, /*refines=*/true);
  Push(/*is_tile=*/false, /*is_deferral=*/true);
  const isoscope::v1::InteractResponse* const sent = outbox_.BeginWrite(now_);
  ASSERT_NE(sent, nullptr);
  EXPECT_TRUE(sent->has_exact_deferred());
  EXPECT_EQ(schedule_.under_way_count(), 0);
  EXPECT_TRUE(schedule_.Next(now_).start.has_value());
}

}  // namespace
}  // namespace isoscope::server
