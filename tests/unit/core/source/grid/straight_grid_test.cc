#include "core/source/grid/straight_grid.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/math/elementary.h"

namespace isoscope::source {
namespace {

double DistanceOf(const math::Mat3d& a, const math::Mat3d& b) {
  double sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const math::Vec3d off = a.columns[axis] - b.columns[axis];
    sum += math::Dot(off, off);
  }
  return std::sqrt(sum);
}

// Two axes in a plane, 60 degrees apart: each turns by 15 degrees.
TEST(StraightGridTest, NoAxisGoesBeforeAnother) {
  const double s = std::sqrt(0.75);
  const math::Mat3d nearest =
      NearestRightAngles({{math::Vec3d{1, 0, 0}, math::Vec3d{0.5, s, 0}, math::Vec3d{0, 0, -1}}});
  const double c15 = (std::sqrt(6.0) + std::sqrt(2.0)) / 4;
  const double s15 = (std::sqrt(6.0) - std::sqrt(2.0)) / 4;
  EXPECT_LT(DistanceOf(nearest, {{math::Vec3d{c15, -s15, 0}, math::Vec3d{s15, c15, 0},
                                  math::Vec3d{0, 0, -1}}}),
            1e-15);
}

TEST(StraightGridTest, IsOrthonormalAndNearerThanItsNeighbours) {
  const math::Mat3d from{
      {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.48, 0.6, 0.64}, math::Vec3d{0.36, 0.48, 0.8}}};
  ASSERT_TRUE(FindShear(from).has_value());
  const math::Mat3d nearest = NearestRightAngles(from);
  EXPECT_FALSE(FindShear(nearest).has_value());
  EXPECT_NEAR(math::Determinant(nearest), 1, 1e-14);
  for (std::size_t a = 0; a < 3; ++a) {
    EXPECT_NEAR(math::Length(nearest.columns[a]), 1, 1e-14);
    // A little turn about any axis is farther away.
    for (const double angle : {-1e-3, 1e-3}) {
      math::Vec3d axis;
      axis[static_cast<int>(a)] = 1;
      math::Mat3d turned = nearest;
      for (math::Vec3d& column : turned.columns) {
        column = column * math::Cos(angle) + math::Cross(axis, column) * math::Sin(angle) +
                 axis * (math::Dot(axis, column) * (1 - math::Cos(angle)));
      }
      EXPECT_GT(DistanceOf(turned, from), DistanceOf(nearest, from));
    }
  }
}

// The least determinant of a valid grid.
TEST(StraightGridTest, NearlyFlatAxesEndToo) {
  const math::Mat3d nearest = NearestRightAngles(
      {{math::Vec3d{1, 0, 0}, math::Vec3d{1, 0, 1e-3} * (1 / std::hypot(1, 1e-3)),
        math::Vec3d{0, 1, 0}}});
  EXPECT_FALSE(FindShear(nearest).has_value());
  EXPECT_NEAR(std::abs(math::Determinant(nearest)), 1, 1e-9);
}

TEST(StraightGridTest, FirstSampleAndDistancesStay) {
  volume::GridGeometry from;
  from.sample_dims = {5, 4, 3};
  from.spacing = {2, 3, 4};
  from.origin = {7, 8, 9};
  from.direction = {{math::Vec3d{1, 0, 0}, math::Vec3d{0.6, 0.8, 0}, math::Vec3d{0, 0, 2}}};
  const volume::GridGeometry straight = StraightGrid(from);
  EXPECT_EQ(straight.origin, from.origin);
  EXPECT_EQ(straight.sample_dims, from.sample_dims);
  EXPECT_EQ(straight.spacing, (math::Vec3d{2, 3, 8}));  // its third direction had the length 2
  EXPECT_FALSE(FindShear(straight.direction).has_value());
  const std::string text = DescribeStraightening(*FindShear(from.direction), from, straight);
  EXPECT_THAT(text, ::testing::HasSubstr("axes x and y, which meet at 53.13 degrees"));
  // x and y turn by 18.43 degrees in opposite senses: 9 and 8 long, the corner of both moves most.
  EXPECT_THAT(text, ::testing::HasSubstr("moved by up to 3.195"));
}

}  // namespace
}  // namespace isoscope::source
