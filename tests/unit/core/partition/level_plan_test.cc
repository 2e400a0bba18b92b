#include "core/partition/level_plan.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::LevelFilter;
using volume::ScalarType;

TEST(PlanLevelsTest, ShardsBoundTheLevelsThatAutoMakes) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {1024, 1024, 1024};
  const auto highest = [&](int shard_count) {
    return PlanLevels({.highest = LevelOptions::kAuto}, geometry, ScalarType::kUint16, {16, 16, 16},
                      shard_count, false)
        ->highest;
  };
  EXPECT_EQ(highest(1), 4);
  EXPECT_EQ(highest(64), 4);  // 64^3 samples in 4^3 blocks
  EXPECT_EQ(highest(65), 3);
}

TEST(PlanLevelsTest, BytesOfLevelsAreThoseOfTheirSamples) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 8, 7};
  EXPECT_EQ(BytesOfLevels({.highest = 1}, geometry, ScalarType::kUint8), 2 * 4 * 4 * 3);
  EXPECT_EQ(BytesOfLevels({.highest = 0}, geometry, ScalarType::kUint8), 0);
  EXPECT_EQ(
      BytesOfLevels({.highest = 1, .filter = LevelFilter::kMajority}, geometry, ScalarType::kUint8),
      4 * 4 * 3);
}

TEST(PlanLevelsTest, ANumberThatIsTooHighIsRefusedWithWhatIsPossible) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {40, 17, 64};
  const auto plan = [&](int highest) {
    return PlanLevels({.highest = highest}, geometry, ScalarType::kUint8, {8, 8, 8}, 1, false);
  };
  EXPECT_EQ(plan(3)->highest, 3);  // 5 x 2 x 8 samples
  EXPECT_THAT(plan(4),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0 to 3 are possible")));
  EXPECT_THAT(plan(-2), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_EQ(plan(0)->highest, 0);
}

TEST(FilterForTest, LabelsOfIntegersGetMajoritiesUnlessMeansAreAskedFor) {
  EXPECT_EQ(FilterFor({}, ScalarType::kUint8, false), LevelFilter::kMean);
  EXPECT_EQ(FilterFor({}, ScalarType::kUint8, true), LevelFilter::kMajority);
  EXPECT_EQ(FilterFor({}, ScalarType::kFloat32, true), LevelFilter::kMean);
  EXPECT_EQ(FilterFor({.filter = LevelFilter::kMean}, ScalarType::kUint8, true),
            LevelFilter::kMean);
  EXPECT_EQ(FilterFor({.filter = LevelFilter::kMajority}, ScalarType::kInt32, false),
            LevelFilter::kMajority);
  EXPECT_EQ(FilterFor({.filter = LevelFilter::kMajority}, ScalarType::kFloat64, false),
            LevelFilter::kMean);
}

}  // namespace
}  // namespace isoscope::partition
