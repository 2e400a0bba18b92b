// Streams of events with invented times: what is drawn, what is cancelled, and who waits for whom.

#include "server/interact/interactive_schedule.h"

#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

using Schedule = InteractiveSchedule;

base::MonotonicTime At(double ms) { return base::MonotonicTime() + absl::Milliseconds(ms); }

// Begins what the schedule says, and returns it; work 0 if there is nothing.
FrameStart StartAt(Schedule* schedule, double ms) {
  return schedule->Next(At(ms)).start.value_or(FrameStart{});
}

// Draws and sends the frame of the newest state within `took_ms`, and lets the client show it.
void ShowFrame(Schedule* schedule, double ms, double took_ms, std::int64_t number) {
  const FrameStart start = StartAt(schedule, ms);
  ASSERT_NE(start.work, 0);
  schedule->OnWorkEnded(start.work, /*has_answer=*/true, At(ms + took_ms));
  schedule->OnSent(number, At(ms + took_ms), start.is_exact);
  EXPECT_TRUE(schedule->OnShown(number, At(ms + took_ms)).has_value());
}

TEST(InteractiveScheduleTest, NothingIsDrawnBeforeTheFirstState) {
  Schedule schedule;
  const Schedule::Step step = schedule.Next(At(0));
  EXPECT_FALSE(step.start.has_value());
  EXPECT_EQ(step.wake, base::MonotonicTime::InfiniteFuture());
}

TEST(InteractiveScheduleTest, AStateIsDrawnMovingAtOnceAndExactOnceItRests) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  const FrameStart moving = StartAt(&schedule, 0);
  EXPECT_EQ(moving.sequence, 1);
  EXPECT_FALSE(moving.is_exact);
  const Schedule::Step waiting = schedule.Next(At(1));
  EXPECT_FALSE(waiting.start.has_value()) << "a state is drawn moving once";
  EXPECT_EQ(waiting.wake, At(120));
  schedule.OnWorkEnded(moving.work, true, At(30));
  EXPECT_EQ(StartAt(&schedule, 119).work, 0);
  const FrameStart exact = StartAt(&schedule, 120);
  EXPECT_EQ(exact.sequence, 1);
  EXPECT_TRUE(exact.is_exact);
  schedule.OnWorkEnded(exact.work, true, At(200));
  EXPECT_EQ(StartAt(&schedule, 5000).work, 0) << "an exact frame comes once";
}

TEST(InteractiveScheduleTest, AStateThatSaysThatItRestsIsExactWithoutDelay) {
  Schedule schedule;
  schedule.OnState(1, true, At(0));
  EXPECT_TRUE(StartAt(&schedule, 0).is_exact);
}

TEST(InteractiveScheduleTest, OnlyTheNewestStateIsDrawn) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  ASSERT_EQ(StartAt(&schedule, 0).sequence, 1);
  schedule.OnState(2, false, At(5));
  schedule.OnState(3, false, At(6));
  EXPECT_EQ(StartAt(&schedule, 7).work, 0) << "one is drawn";
  schedule.OnDrawn(1);
  EXPECT_EQ(StartAt(&schedule, 8).sequence, 3);
  schedule.OnState(4, false, At(9));
  schedule.OnDrawn(2);
  EXPECT_EQ(StartAt(&schedule, 9).work, 0) << "two are encoded";
  schedule.OnWorkEnded(1, /*has_answer=*/false, At(10));
  EXPECT_EQ(StartAt(&schedule, 10).sequence, 4);
}

TEST(InteractiveScheduleTest, APictureThatIsDrawnIsNotCancelledAndOneThatIsCancelledHoldsNobodyUp) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  ShowFrame(&schedule, 0, 400, 1);  // frames take 400 ms
  schedule.OnState(2, false, At(400));
  const FrameStart second = StartAt(&schedule, 400);
  schedule.OnDrawn(second.work);
  schedule.OnDrawn(77);  // never begun
  schedule.OnState(3, false, At(450));
  const Schedule::Step step = schedule.Next(At(450));
  EXPECT_TRUE(step.cancel.empty());
  ASSERT_TRUE(step.start.has_value());
  schedule.OnWorkEnded(second.work, /*has_answer=*/false, At(460));
  schedule.OnState(4, false, At(470));
  const Schedule::Step next = schedule.Next(At(470));
  EXPECT_EQ(next.cancel, std::vector<std::int64_t>{step.start->work});
  EXPECT_EQ(next.start.value_or(FrameStart{}).sequence, 4);
}

TEST(InteractiveScheduleTest, FramesThatWereNotShownHoldCreditsUntilTheyTimeOut) {
  Schedule schedule;
  for (std::int64_t i = 1; i <= 2; ++i) {
    const double ms = 10.0 * static_cast<double>(i);
    schedule.OnState(i, false, At(ms));
    const FrameStart start = StartAt(&schedule, ms);
    schedule.OnWorkEnded(start.work, true, At(ms + 5));
    schedule.OnSent(i, At(ms + 5));
  }
  schedule.OnState(3, false, At(30));
  EXPECT_EQ(StartAt(&schedule, 30).work, 0) << "two frames are under way";
  EXPECT_EQ(schedule.OnShown(1, At(40)), absl::Milliseconds(25));
  EXPECT_EQ(schedule.OnShown(1, At(41)), std::nullopt) << "shown twice";
  EXPECT_EQ(schedule.OnShown(77, At(41)), std::nullopt) << "never sent";
  const FrameStart third = StartAt(&schedule, 42);
  EXPECT_EQ(third.sequence, 3);
  schedule.OnWorkEnded(third.work, true, At(50));
  schedule.OnSent(3, At(50));
  schedule.OnState(4, false, At(2000));
  EXPECT_EQ(StartAt(&schedule, 2000).work, 0);
  schedule.OnState(5, false, At(2030));
  const Schedule::Step step = schedule.Next(At(2030));
  EXPECT_EQ(step.overdue, std::vector<std::int64_t>{2}) << "it was sent at 25";
  EXPECT_EQ(step.start.value_or(FrameStart{}).sequence, 5);
  EXPECT_EQ(schedule.OnShown(2, At(3025)), absl::Seconds(3)) << "late, but known";
}

TEST(InteractiveScheduleTest, AStalledClientStillGetsItsExactFrame) {
  Schedule schedule;
  for (std::int64_t i = 1; i <= 2; ++i) {
    schedule.OnState(i, false, At(0));
    schedule.OnWorkEnded(StartAt(&schedule, 0).work, true, At(5));
    schedule.OnSent(i, At(5));
  }
  EXPECT_TRUE(StartAt(&schedule, 130).is_exact);
}

TEST(InteractiveScheduleTest, MoreCreditsLetMoreFramesUnderWayUpToTheLimit) {
  for (const auto& [credits, expected] : {std::pair{1, 2}, {5, 5}, {100, 8}}) {
    Schedule schedule;
    schedule.SetCredits(credits);
    int begun = 0;
    for (std::int64_t i = 1; i <= 20; ++i) {
      schedule.OnState(i, false, At(0));
      const FrameStart start = StartAt(&schedule, 0);
      if (start.work != 0) {
        ++begun;
        schedule.OnWorkEnded(start.work, true, At(0));
        schedule.OnSent(i, At(0));
      }
    }
    EXPECT_EQ(begun, expected) << credits;
    EXPECT_EQ(schedule.under_way_count(), expected);
  }
}

TEST(InteractiveScheduleTest, ASlowFrameThatWasReplacedIsCancelledInItsFirstHalfAndNeverTwoInARow) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  ShowFrame(&schedule, 0, 400, 1);  // frames take 400 ms
  schedule.OnState(2, false, At(400));
  const FrameStart second = StartAt(&schedule, 400);
  schedule.OnState(3, false, At(500));
  Schedule::Step step = schedule.Next(At(500));
  ASSERT_EQ(step.cancel, std::vector<std::int64_t>{second.work});
  ASSERT_TRUE(step.start.has_value());
  const FrameStart third = *step.start;
  EXPECT_EQ(third.sequence, 3);
  schedule.OnState(4, false, At(510));
  EXPECT_TRUE(schedule.Next(At(510)).cancel.empty()) << "one is being cancelled";
  schedule.OnWorkEnded(second.work, /*has_answer=*/false, At(515));
  EXPECT_TRUE(schedule.Next(At(516)).cancel.empty()) << "the one before was cancelled";
  schedule.OnWorkEnded(third.work, true, At(900));
  schedule.OnSent(3, At(900));
}

TEST(InteractiveScheduleTest, ASlowFrameIsLetEndInItsSecondHalf) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  ShowFrame(&schedule, 0, 400, 1);
  schedule.OnState(2, false, At(400));
  StartAt(&schedule, 400);
  schedule.OnState(3, false, At(601));
  EXPECT_TRUE(schedule.Next(At(601)).cancel.empty());
}

TEST(InteractiveScheduleTest, QuickFramesAreNotCancelled) {
  Schedule schedule;
  schedule.OnState(1, false, At(0));
  ShowFrame(&schedule, 0, 30, 1);
  schedule.OnState(2, false, At(40));
  StartAt(&schedule, 40);
  schedule.OnState(3, false, At(45));
  EXPECT_TRUE(schedule.Next(At(45)).cancel.empty());
}

TEST(InteractiveScheduleTest, AnExactFrameIsCancelledWhenTheViewMovesOnAndComesAfterIt) {
  Schedule schedule;
  schedule.OnState(1, true, At(0));
  ShowFrame(&schedule, 0, 80, 1);  // exact frames take 80 ms
  schedule.OnState(2, true, At(100));
  const FrameStart exact = StartAt(&schedule, 100);
  schedule.OnState(3, false, At(110));
  const Schedule::Step step = schedule.Next(At(110));
  EXPECT_EQ(step.cancel, std::vector<std::int64_t>{exact.work});
  ASSERT_TRUE(step.start.has_value());
  EXPECT_FALSE(step.start->is_exact);
  schedule.OnWorkEnded(exact.work, false, At(112));
  schedule.OnWorkEnded(step.start->work, true, At(140));
  const FrameStart again = StartAt(&schedule, 230);
  EXPECT_TRUE(again.is_exact);
  EXPECT_EQ(again.sequence, 3);
}

// Symptom: a client that acknowledged nothing got every exact frame that could be drawn.
TEST(InteractiveScheduleTest, ExactFramesThatWereNotShownHoldTheNextOneUntilTheyTimeOut) {
  Schedule schedule;
  for (std::int64_t i = 1; i <= 2; ++i) {
    schedule.OnState(i, true, At(10));
    const FrameStart start = StartAt(&schedule, 10);
    ASSERT_TRUE(start.is_exact);
    schedule.OnWorkEnded(start.work, true, At(20));
    schedule.OnSent(i, At(20), /*is_exact=*/true);
  }
  schedule.OnState(3, true, At(30));
  const Schedule::Step held = schedule.Next(At(30));
  EXPECT_FALSE(held.start.has_value());
  EXPECT_EQ(held.wake, At(2020));
  EXPECT_EQ(StartAt(&schedule, 2020).sequence, 3);

  schedule.OnWorkEnded(3, true, At(2030));
  schedule.OnSent(3, At(2030), /*is_exact=*/true);
  schedule.OnState(4, true, At(2040));
  EXPECT_EQ(StartAt(&schedule, 2040).sequence, 4);
}

TEST(InteractiveScheduleTest, AnExactFrameThatWaitsForTheNetworkHoldsTheNextOne) {
  Schedule schedule;
  schedule.OnState(1, true, At(0));
  schedule.OnWorkEnded(StartAt(&schedule, 0).work, true, At(5));
  schedule.OnState(2, true, At(10));
  EXPECT_EQ(StartAt(&schedule, 10).work, 0);
  schedule.OnDropped(/*is_exact=*/true);
  EXPECT_EQ(StartAt(&schedule, 11).sequence, 2);
}

// Symptom: each wrong state was answered with an error.
TEST(InteractiveScheduleTest, NothingBeginsForAWhileAfterAnError) {
  Schedule schedule;
  schedule.OnState(1, true, At(0));
  const FrameStart wrong = StartAt(&schedule, 0);
  schedule.OnWorkEnded(wrong.work, true, At(1));
  schedule.OnError(At(1));
  schedule.OnSent(1, At(1), /*is_exact=*/true);
  schedule.OnShown(1, At(1));
  schedule.OnState(2, true, At(2));
  schedule.OnState(3, true, At(3));
  const Schedule::Step step = schedule.Next(At(3));
  EXPECT_FALSE(step.start.has_value());
  EXPECT_EQ(step.wake, At(101));
  EXPECT_EQ(StartAt(&schedule, 101).sequence, 3) << "the newest, and no other";
}

TEST(InteractiveScheduleTest, ADroppedAnswerGivesItsCreditBack) {
  Schedule schedule;
  for (std::int64_t i = 1; i <= 2; ++i) {
    schedule.OnState(i, false, At(0));
    schedule.OnWorkEnded(StartAt(&schedule, 0).work, true, At(5));
  }
  EXPECT_EQ(schedule.under_way_count(), 2);
  schedule.OnDropped();
  EXPECT_EQ(schedule.under_way_count(), 1);
  schedule.OnState(3, false, At(6));
  EXPECT_EQ(StartAt(&schedule, 6).sequence, 3);
}

// A view that refines: its exact frame is several works.
TEST(InteractiveScheduleTest, PartsOfAnExactFrameFollowEachOther) {
  Schedule schedule;
  schedule.OnState(1, true, At(0), /*refines=*/true);
  for (int part = 1; part <= 3; ++part) {
    const FrameStart start = StartAt(&schedule, 10 * part);
    ASSERT_EQ(start.work, part);
    EXPECT_TRUE(start.is_exact);
    EXPECT_EQ(StartAt(&schedule, 10 * part).work, 0) << "one at a time";
    schedule.OnWorkEnded(start.work, /*has_answer=*/true, At(10 * part + 5));
    schedule.OnSent(part, At(10 * part + 5), /*is_exact=*/true, /*is_part=*/true);
    EXPECT_EQ(StartAt(&schedule, 10 * part + 6).work, 0) << "unless it goes on";
    schedule.ContinueExact();
  }
}

TEST(InteractiveScheduleTest, APartIsCancelledAtOnceByAnotherPictureAndEachTime) {
  Schedule schedule;
  for (int state = 1; state <= 3; ++state) {
    schedule.OnState(2 * state, true, At(1000 * state), /*refines=*/true);
    const FrameStart part = StartAt(&schedule, 1000 * state);
    ASSERT_TRUE(part.is_exact);
    schedule.OnDrawn(part.work);
    schedule.OnState(2 * state + 1, false, At(1000 * state + 900), /*refines=*/true);
    const Schedule::Step step = schedule.Next(At(1000 * state + 900));
    ASSERT_EQ(step.cancel.size(), 1U) << "however long it has been drawn";
    EXPECT_EQ(step.cancel[0], part.work);
    ASSERT_TRUE(step.start.has_value()) << "a cancelled work holds nobody up";
    EXPECT_FALSE(step.start->is_exact);
    schedule.OnWorkEnded(part.work, /*has_answer=*/false, At(1000 * state + 901));
    schedule.OnWorkEnded(step.start->work, /*has_answer=*/false, At(1000 * state + 902));
  }
}

TEST(InteractiveScheduleTest, AStateWithTheSamePictureBeginsAndCancelsNothing) {
  Schedule schedule;
  schedule.OnState(1, false, At(0), /*refines=*/true);
  const FrameStart moving = StartAt(&schedule, 0);
  schedule.OnSamePicture(2, false);
  EXPECT_EQ(StartAt(&schedule, 10).work, 0) << "its moving frame is drawn";
  schedule.OnWorkEnded(moving.work, /*has_answer=*/false, At(20));
  schedule.OnSamePicture(3, false);
  const FrameStart part = StartAt(&schedule, 120);
  EXPECT_TRUE(part.is_exact) << "120 ms after the picture came, not after its newest state";
  EXPECT_EQ(part.sequence, 3);
  schedule.OnSamePicture(4, false);
  const Schedule::Step step = schedule.Next(At(130));
  EXPECT_TRUE(step.cancel.empty());
  EXPECT_FALSE(step.start.has_value());
  schedule.OnWorkEnded(part.work, /*has_answer=*/false, At(140));
  EXPECT_EQ(StartAt(&schedule, 150).work, 0) << "the exact frame was begun for it, too";
}

TEST(InteractiveScheduleTest, FourPartsMayBeUnshownAndDelayNoMovingFrame) {
  Schedule schedule;
  schedule.OnState(1, true, At(0), /*refines=*/true);
  for (int part = 1; part <= Schedule::kPartCredits; ++part) {
    const FrameStart start = StartAt(&schedule, 10 * part);
    ASSERT_NE(start.work, 0) << part;
    schedule.OnWorkEnded(start.work, /*has_answer=*/true, At(10 * part));
    schedule.OnSent(part, At(10 * part), /*is_exact=*/true, /*is_part=*/true);
    schedule.ContinueExact();
  }
  EXPECT_EQ(StartAt(&schedule, 100).work, 0) << "the client is behind";
  EXPECT_EQ(schedule.under_way_count(), 0);
  EXPECT_TRUE(schedule.OnShown(1, At(110)).has_value());
  EXPECT_NE(StartAt(&schedule, 110).work, 0);
  EXPECT_EQ(schedule.under_way_count(), 1) << "the one in work";
  for (int part = 2; part <= Schedule::kPartCredits; ++part) {
    EXPECT_TRUE(schedule.OnShown(part, At(120)).has_value());
  }
  EXPECT_EQ(schedule.under_way_count(), 1);
}

TEST(InteractiveScheduleTest, AViewThatDoesNotRefineHasTwoExactFramesUnshownAsBefore) {
  Schedule schedule;
  for (int state = 1; state <= 2; ++state) {
    schedule.OnState(state, true, At(10 * state));
    const FrameStart exact = StartAt(&schedule, 10 * state);
    ASSERT_TRUE(exact.is_exact);
    schedule.OnWorkEnded(exact.work, /*has_answer=*/true, At(10 * state));
    schedule.OnSent(state, At(10 * state), /*is_exact=*/true);
  }
  EXPECT_EQ(schedule.under_way_count(), 2);
  schedule.OnState(3, true, At(30));
  EXPECT_EQ(StartAt(&schedule, 30).work, 0);
}

}  // namespace
}  // namespace isoscope::server
