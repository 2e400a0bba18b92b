#include "core/source/grid/grid_faults.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

volume::GridGeometry Grid() {
  volume::GridGeometry grid;
  grid.sample_dims = {4, 3, 2};
  grid.spacing = {0.5, 2, 4};
  grid.origin = {10, 20, 30};
  grid.direction.columns = {{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}}};
  return grid;
}

TEST(GridFaultsTest, GoodGridStaysAsItIs) {
  volume::GridGeometry grid = Grid();
  EXPECT_TRUE(TakeGridByRules("a", {}, &grid).ok());
  EXPECT_EQ(grid, Grid());
}

TEST(GridFaultsTest, DistancesThatAreNoneAreGivenBySpacing) {
  for (const double bad : {0.0, -1.0, kNan, kInfinity}) {
    volume::GridGeometry grid = Grid();
    grid.spacing.y = bad;
    volume::GridGeometry given = grid;
    EXPECT_THAT(TakeGridByRules("a", {.has_origin = true, .has_direction = true}, &grid),
                StatusIs(kInvalid, AllOf(StartsWith("a: spacing 0.5, "),
                                         HasSubstr("--spacing X,Y,Z"), Not(HasSubstr("--or")))));
    EXPECT_TRUE(TakeGridByRules("a", {.has_spacing = true}, &given).ok());
    EXPECT_EQ(given.spacing, (math::Vec3d{0.5, 1, 4}));
    EXPECT_EQ(given.direction, Grid().direction);
    EXPECT_EQ(given.origin, Grid().origin);
  }
}

TEST(GridFaultsTest, OriginAndDirectionsThatAreNoneAreGivenByTheirFlags) {
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    volume::GridGeometry grid = Grid();
    grid.origin.z = bad;
    volume::GridGeometry given = grid;
    EXPECT_THAT(
        TakeGridByRules("a", {.has_spacing = true, .has_direction = true}, &grid),
        StatusIs(kInvalid, AllOf(StartsWith("a: origin 10, 20, "), HasSubstr("--origin X,Y,Z"))));
    EXPECT_TRUE(TakeGridByRules("a", {.has_origin = true}, &given).ok());
    EXPECT_EQ(given.origin, (math::Vec3d{0, 0, 0}));
  }
  for (const math::Vec3d& bad : {math::Vec3d{0, 0, 0}, math::Vec3d{kNan, 0, 0},
                                 math::Vec3d{0, kInfinity, 0}, math::Vec3d{0, 0, 2}}) {
    volume::GridGeometry grid = Grid();
    grid.direction.columns[1] = bad;
    volume::GridGeometry given = grid;
    EXPECT_THAT(TakeGridByRules("a", {.has_spacing = true, .has_origin = true}, &grid),
                StatusIs(kInvalid, AllOf(StartsWith("a: directions (0, 1, 0), ("),
                                         HasSubstr("--direction XX,XY"))));
    EXPECT_TRUE(TakeGridByRules("a", {.has_direction = true}, &given).ok());
    EXPECT_EQ(given.direction, math::Mat3d());
    EXPECT_EQ(given.spacing, Grid().spacing);
  }
}

TEST(GridFaultsTest, AllFlagsThatAreNeededAreSaidAtOnce) {
  volume::GridGeometry grid = Grid();
  grid.spacing.x = 0;
  grid.direction.columns[1] = {0, 0, 0};
  grid.origin.x = kNan;
  GridFaults faults;
  ReplaceFaults("dir/a.nrrd", &grid, &faults);
  EXPECT_FALSE(faults.ok());
  EXPECT_THAT(faults.Check({}, "dir/a.nrrd"),
              StatusIs(kInvalid, AllOf(StartsWith("dir/a.nrrd: spacing"), HasSubstr("--spacing X"),
                                       HasSubstr("; and directions"), HasSubstr("--direction XX"),
                                       HasSubstr("; and origin nan"), HasSubstr("--origin X"))));
  EXPECT_THAT(faults.Check({.has_spacing = true, .has_origin = true}, "dir/a.nrrd"),
              StatusIs(kInvalid, StartsWith("dir/a.nrrd: directions")));
  EXPECT_TRUE(
      faults.Check({.has_spacing = true, .has_origin = true, .has_direction = true}, "").ok());
}

}  // namespace
}  // namespace isoscope::source
