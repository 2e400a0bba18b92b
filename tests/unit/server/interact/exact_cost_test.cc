#include "server/interact/exact_cost.h"

#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

constexpr std::int64_t kMiB = std::int64_t{1} << 20;

constexpr bool kMoving = false;
constexpr bool kExact = true;

double Ms(absl::Duration duration) { return absl::ToDoubleMilliseconds(duration); }

TEST(ExactCostTest, AnUnknownStreamIsTakenForOneGibibyteASecond) {
  const ExactCost cost;
  EXPECT_NEAR(Ms(cost.Expected(256 * kMiB)), 250, 1);
  EXPECT_EQ(cost.Expected(0), absl::ZeroDuration());
}

TEST(ExactCostTest, AFrameOfTheSameBytesTakesTheSameTime) {
  ExactCost cost;
  cost.OnFrame(100 * kMiB, absl::Milliseconds(40), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(100 * kMiB)), 40, 0.1);
  EXPECT_NEAR(Ms(cost.Expected(150 * kMiB)), 60, 0.1);
  cost.OnFrame(100 * kMiB, absl::Milliseconds(80), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(100 * kMiB)), 50, 0.1) << "the mean follows within a few frames";
}

TEST(ExactCostTest, MoreBytesLieOnTheLineThroughTwoLevels) {
  ExactCost cost;
  cost.OnFrame(10 * kMiB, absl::Milliseconds(20), kMoving);
  cost.OnFrame(110 * kMiB, absl::Milliseconds(70), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(1110 * kMiB)), 570, 0.5) << "0.5 ms a MiB";
}

TEST(ExactCostTest, ALevelThatWasSlowerToReadGivesNoNegativeTime) {
  ExactCost cost;
  cost.OnFrame(10 * kMiB, absl::Milliseconds(500), kMoving);
  cost.OnFrame(100 * kMiB, absl::Milliseconds(50), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(100 * kMiB + 8 * 1024 * kMiB)), 1050, 1);
}

TEST(ExactCostTest, OneLevelAloneTellsNoSlope) {
  ExactCost cost;
  cost.OnFrame(100 * kMiB, absl::Milliseconds(30), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(100 * kMiB + 1024 * kMiB)), 1030, 1);
}

// Exact frames have more samples and effects.
TEST(ExactCostTest, AnExactFrameCountsBeforeMovingOnes) {
  ExactCost cost;
  cost.OnFrame(100 * kMiB, absl::Milliseconds(800), kExact);
  for (int i = 0; i < 50; ++i) {
    cost.OnFrame(100 * kMiB, absl::Milliseconds(30), kMoving);
    cost.OnFrame(50 * kMiB, absl::Milliseconds(10), kMoving);
  }
  EXPECT_NEAR(Ms(cost.Expected(100 * kMiB)), 800, 0.1);
  EXPECT_NEAR(Ms(cost.Expected(25 * kMiB)), 5, 0.1) << "far from it moving frames count";
}

TEST(ExactCostTest, AnEmptyFrameTellsNothing) {
  ExactCost cost;
  cost.OnFrame(0, absl::Seconds(9), kMoving);
  EXPECT_NEAR(Ms(cost.Expected(256 * kMiB)), 250, 1);
}

}  // namespace
}  // namespace isoscope::server
