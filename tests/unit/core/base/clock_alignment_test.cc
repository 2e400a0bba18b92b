#include "core/base/clock_alignment.h"

#include <random>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(ClockAlignmentTest, AnEvenRoundTripGivesTheOffsetItselfAndHalfTheTripAsError) {
  // The peer's clock is 1000 s ahead; each way takes 2 ms.
  ClockAlignment alignment;
  alignment.AddSent(absl::Milliseconds(10), absl::Seconds(1000) + absl::Milliseconds(12));
  alignment.AddReceived(absl::Seconds(1000) + absl::Milliseconds(30), absl::Milliseconds(32));
  EXPECT_EQ(alignment.offset(), -absl::Seconds(1000));
  EXPECT_EQ(alignment.error(), absl::Milliseconds(2));
}

TEST(ClockAlignmentTest, TheFastestMessageOfEachWayCounts) {
  ClockAlignment alignment;
  alignment.AddSent(absl::Milliseconds(0), absl::Milliseconds(50));  // a slow message
  alignment.AddSent(absl::Milliseconds(60), absl::Milliseconds(61));
  alignment.AddReceived(absl::Milliseconds(70), absl::Milliseconds(73));
  alignment.AddReceived(absl::Milliseconds(80), absl::Milliseconds(190));
  EXPECT_EQ(alignment.offset(), absl::Milliseconds(1));
  EXPECT_EQ(alignment.error(), absl::Milliseconds(2));
}

TEST(ClockAlignmentTest, WithoutMessagesOfOneWayTheErrorIsUnbounded) {
  ClockAlignment none;
  EXPECT_EQ(none.offset(), absl::ZeroDuration());
  EXPECT_EQ(none.error(), absl::InfiniteDuration());
  ClockAlignment one_way;
  one_way.AddSent(absl::Seconds(5), absl::Seconds(7));
  EXPECT_EQ(one_way.offset(), -absl::Seconds(2));
  EXPECT_EQ(one_way.error(), absl::InfiniteDuration());
}

TEST(ClockAlignmentTest, TheTrueOffsetLiesWithinTheErrorForAnyDelays) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> milliseconds(0, 20);
  for (int round = 0; round < 200; ++round) {
    const absl::Duration offset = absl::Milliseconds(1000 * milliseconds(random) - 9000);
    ClockAlignment alignment;
    absl::Duration now;
    for (int message = 0; message < 5; ++message) {
      now += absl::Milliseconds(milliseconds(random));
      const absl::Duration arrival = now + absl::Milliseconds(milliseconds(random));
      if (message % 2 == 0) {
        alignment.AddSent(now, arrival - offset);
      } else {
        alignment.AddReceived(now - offset, arrival);
      }
      now = arrival;
    }
    EXPECT_LE(absl::AbsDuration(alignment.offset() - offset), alignment.error());
  }
}

}  // namespace
}  // namespace isoscope::base
