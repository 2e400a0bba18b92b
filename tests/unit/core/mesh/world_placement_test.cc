#include "core/mesh/world_placement.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <tuple>

#include "gtest/gtest.h"

#include "core/math/vec_conversion.h"

namespace isoscope::mesh {
namespace {

volume::GridGeometry GeometryOf(const math::Index3& dims, const math::Vec3d& spacing,
                                const math::Vec3d& origin) {
  return {.sample_dims = dims, .spacing = spacing, .origin = origin, .direction = {}};
}

// Points half a sample apart on three lines, which meet in one point, and their places in a file.
void ExpectDistinct(const volume::GridGeometry& geometry) {
  const WorldPlacement placement(geometry);
  std::set<std::tuple<double, double, double>> places;
  std::size_t count = 0;
  for (std::int64_t i = 0; i < 2 * (geometry.sample_dims.x - 1); ++i) {
    const float at = 0.5F * static_cast<float>(i);
    for (const math::Vec3f& position : {math::Vec3f{at, 1, 1}, {1, at, 1}, {1, 1, at}}) {
      const math::Vec3d place = placement.PositionOf({position.x, position.y + 0.25F, position.z});
      places.emplace(place.x, place.y, place.z);
      ++count;
    }
  }
  EXPECT_EQ(places.size(), count - 2) << geometry.origin.x;
}

TEST(WorldPlacementTest, StepOfFloat32IsTheDistanceToTheNextOne) {
  for (const float value : {1.0F, 1.5F, 0.75F, 4600000.0F, 16777216.0F, 3e38F, 1e-40F, 2e-38F}) {
    const float next = std::nextafter(value, std::numeric_limits<float>::infinity());
    EXPECT_EQ(StepOfFloat32(static_cast<double>(value)),
              static_cast<double>(next) - static_cast<double>(value))
        << value;
  }
  EXPECT_EQ(StepOfFloat32(0), static_cast<double>(std::numeric_limits<float>::denorm_min()));
}

// The step at 4 600 000 is 0.5; a spacing of 512 is the least that it serves.
TEST(WorldPlacementTest, AnOriginBeginsWhereAStepExceedsAShareOfTheSpacing) {
  const math::Vec3d far{500000, 4600000, 0};
  EXPECT_TRUE(WorldPlacement(GeometryOf({4, 4, 4}, {511, 511, 511}, far)).has_origin());
  EXPECT_FALSE(WorldPlacement(GeometryOf({4, 4, 4}, {512, 512, 512}, far)).has_origin());
  EXPECT_TRUE(WorldPlacement(GeometryOf({4, 4, 4}, {512, 512, 511}, far)).has_origin());
  EXPECT_TRUE(WorldPlacement(GeometryOf({4, 4, 4}, {512, 512, 512}, {0, 0, -9e6})).has_origin());
  EXPECT_FALSE(WorldPlacement(GeometryOf({4, 4, 4}, {1, 1, 1}, {})).has_origin());
  EXPECT_FALSE(WorldPlacement(GeometryOf({512, 512, 512}, {0.5, 0.5, 0.5}, {-250, -250, -1000}))
                   .has_origin());
  // Positions of blocks have steps of 1/1024 there: a finer world has no more.
  EXPECT_FALSE(WorldPlacement(GeometryOf({30000, 4, 4}, {1, 1, 1}, {})).has_origin());
  EXPECT_TRUE(WorldPlacement(GeometryOf({30000, 4, 4}, {1, 1, 1}, {500000, 0, 0})).has_origin());
}

TEST(WorldPlacementTest, NeighboursStayApartWhereverTheVolumeLies) {
  ExpectDistinct(GeometryOf({9, 9, 9}, {0.01, 0.01, 0.01}, {500000, 4600000, 0}));
  ExpectDistinct(GeometryOf({9, 9, 9}, {0.01, 0.02, 0.01}, {-500000, -4600000, 1e7}));
  ExpectDistinct(GeometryOf({9, 9, 9}, {1e-6, 1e-6, 1e-6}, {1e3, 1e3, 1e3}));
  ExpectDistinct(GeometryOf({9, 9, 9}, {1e-9, 1e-9, 1e-9}, {0, 0, 1}));
  volume::GridGeometry rotated = GeometryOf({9, 9, 9}, {0.01, 0.01, 0.01}, {500000, 4600000, 0});
  rotated.direction = {{math::Vec3d{0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0, -1}}};
  ExpectDistinct(rotated);
}

TEST(WorldPlacementTest, AnOriginHasFewDigitsAndIsNearTheVolume) {
  const WorldPlacement utm(
      GeometryOf({65, 65, 33}, {0.01, 0.01, 0.01}, {500000.123, 4600000.987, -2.345}));
  EXPECT_EQ(utm.origin(), (math::Vec3d{500000.1, 4600000.9, -2.4}));
  const WorldPlacement small(GeometryOf({5, 5, 5}, {1e-6, 1e-6, 1e-6}, {1e3, -1e3, 0}));
  EXPECT_EQ(small.origin(), (math::Vec3d{1e3, -1e3, 0}));
  EXPECT_FALSE(std::signbit(small.origin().z));
  const WorldPlacement large(GeometryOf({101, 5, 5}, {2, 2, 2}, {-123456789, 5, 1e8}));
  EXPECT_EQ(large.origin(), (math::Vec3d{-123456800, 0, 1e8}));
}

// Without an origin a file has the float32 of the world position, and no more.
TEST(WorldPlacementTest, NearTheOriginPositionsAreFloat32) {
  const volume::GridGeometry geometry = GeometryOf({9, 9, 9}, {0.3, 0.3, 0.3}, {0.1, 20, -7});
  const WorldPlacement placement(geometry);
  EXPECT_EQ(placement.origin(), math::Vec3d());
  for (int i = 0; i < 16; ++i) {
    const math::Vec3f position{0.37F * static_cast<float>(i), 1, 0.11F};
    const math::Vec3f offset = placement.OffsetOf(position);
    EXPECT_EQ(offset, math::FloatOf(math::TransformPoint(geometry.world_from_index(),
                                                         math::DoubleOf(position))));
    EXPECT_EQ(placement.PositionOf(position), math::DoubleOf(offset));
  }
}

// The compiler must not leave out the rounding to float32, not even where it vectorises.
TEST(WorldPlacementTest, PlacesAreRoundedPositions) {
  const volume::GridGeometry geometry =
      GeometryOf({9, 9, 9}, {0.01, 0.01, 0.01}, {500000, 4600000, 0});
  const WorldPlacement placement(geometry);
  ASSERT_GT(placement.blur(), 0);
  for (int i = 0; i < 64; ++i) {
    const math::Vec3f position{0.37F * static_cast<float>(i % 21), 1, 0.11F};
    const math::Vec3d place = placement.PlaceOf(position);
    const math::Vec3f offset = placement.OffsetOf(position);
    EXPECT_EQ(place, placement.origin() + math::DoubleOf(offset));
    EXPECT_EQ(place, placement.PositionOf(position));
  }
}

// Points of one place are within the blur, so a search of that size finds them all.
TEST(WorldPlacementTest, PointsOfOnePlaceAreWithinTheBlur) {
  for (const math::Vec3d& spacing :
       {math::Vec3d{1, 1, 1}, {1e-3, 1e-3, 1e-3}, {0.5, 2e-3, 40}, {512, 512, 512}}) {
    const volume::GridGeometry geometry = GeometryOf({40, 40, 40}, spacing, {1e5, 4600000, -3});
    const WorldPlacement placement(geometry);
    ASSERT_GT(placement.blur(), 0);
    ASSERT_LT(placement.blur(), 0.125);
    for (int axis = 0; axis < 3; ++axis) {
      math::Vec3f position{35, 35, 35};
      const math::Vec3d place = placement.PlaceOf(position);
      const float first = position[axis];
      while (placement.PlaceOf(position) == place) {
        position[axis] = std::nextafter(position[axis], 36.0F);
      }
      EXPECT_LE(static_cast<double>(position[axis] - first), placement.blur() + 1e-5) << axis;
    }
  }
}

TEST(WorldPlacementTest, WithoutABoundOfTheBlurPlacesArePositions) {
  volume::GridGeometry geometry = GeometryOf({4, 4, 4}, {1, 1, 1}, {});
  geometry.direction = {{math::Vec3d{1, 0, 0}, {1, 1e-7, 0}, {0, 0, 1}}};
  const WorldPlacement placement(geometry);
  EXPECT_EQ(placement.blur(), 0);
  EXPECT_EQ(placement.PlaceOf({1.5F, 2, 0.25F}), (math::Vec3d{1.5, 2, 0.25}));
}

// Of 2^20 samples a float32 index has steps of 1/16, of 2^21 of 1/8: the bound with its slack is
// above 1/8 there, and the places of two vertices may be one.
TEST(WorldPlacementTest, ABlurOfAnEighthIsNoBound) {
  const auto blur_of = [](std::int64_t samples) {
    return WorldPlacement(GeometryOf({samples, 4, 4}, {1, 1, 1}, {})).blur();
  };
  EXPECT_GT(blur_of(std::int64_t{1} << 20), 0);
  EXPECT_EQ(blur_of((std::int64_t{1} << 20) + 2), 0);
}

}  // namespace
}  // namespace isoscope::mesh
