#include "core/view/clip_crossings.h"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/math/matrix.h"
#include "core/view/unprojection.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {41, 41, 41};
  geometry.spacing = {0.5, 1, 1};
  geometry.origin = {-10, -20, -20};
  return geometry;
}

// From +z to the middle, 40 units high: 80 pixels, half a unit each.
View LookingDown(Projection projection, const std::optional<Region>& region = {}) {
  Camera camera;
  camera.eye = {0, 0, 100};
  camera.target = {0, 0, 0};
  camera.up = {0, 1, 0};
  camera.projection = projection;
  camera.view_height = 40;
  camera.fov_y_radians = 2 * std::atan(0.2);
  absl::StatusOr<View> view = View::Make(camera, {100, 80}, Geometry(), region);
  EXPECT_THAT(view, isoscope::testing::IsOk());
  return *std::move(view);
}

ClipRegion Planes(std::vector<HalfSpace> half_spaces) {
  ClipRegion region;
  region.half_spaces = std::move(half_spaces);
  return region;
}

math::Vec3d WorldOf(const ClipCrossing& crossing) {
  return math::TransformPoint(Geometry().world_from_index(), crossing.position);
}

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_NEAR(math::Length(a - b), 0, 1e-9) << a.x << " " << a.y << " " << a.z;
}

TEST(ClipCrossingFinderTest, ASlabIsEnteredAtOneBorderAndLeftAtTheOther) {
  const ClipRegion slab = Planes({{{0, 0, 2}, -10}, {{0, 0, -1}, -8}});  // -5 <= z <= 8
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    const View view = LookingDown(projection);
    const ClipCrossingFinder finder(view, Clipper(slab, Geometry()));
    const ClipCrossings crossings = finder.At(50, 40);
    ASSERT_TRUE(crossings.entry.has_value());
    ASSERT_TRUE(crossings.exit.has_value());
    EXPECT_EQ(crossings.entry->half_space, 1U);
    EXPECT_EQ(crossings.exit->half_space, 0U);
    ExpectNear(WorldOf(*crossings.entry), {0, 0, 8});
    ExpectNear(WorldOf(*crossings.exit), {0, 0, -5});
    // Its depth is that of the planes.
    EXPECT_NEAR(static_cast<double>(Unprojection(view).DistanceOf(crossings.entry->depth)), 92,
                1e-3);
    EXPECT_NEAR(static_cast<double>(Unprojection(view).DistanceOf(crossings.exit->depth)), 105,
                1e-3);
  }
}

TEST(ClipCrossingFinderTest, ThePointIsSeenAtItsPixel) {
  const ClipRegion tilted = Planes({{{1, 2, -4}, -3}});
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    const View view = LookingDown(projection);
    const ClipCrossingFinder finder(view, Clipper(tilted, Geometry()));
    const ClipCrossings crossings = finder.At(61.5, 33.5);
    ASSERT_TRUE(crossings.entry.has_value());
    EXPECT_FALSE(crossings.exit.has_value());
    const math::Vec3d world = WorldOf(*crossings.entry);
    EXPECT_NEAR(math::Dot(world, math::Vec3d{1, 2, -4}), -3, 1e-9);
    const float distance = Unprojection(view).DistanceOf(crossings.entry->depth);
    EXPECT_NEAR(math::Length(world - Unprojection(view).PositionOf(61, 33, distance)), 0, 2e-3);
    const math::Vec3d direction = finder.DirectionAt(61.5, 33.5);
    if (projection == Projection::kPerspective) {
      EXPECT_NEAR(math::Length(math::Cross(direction, world - math::Vec3d{0, 0, 100})), 0, 1e-9);
    }
  }
}

TEST(ClipCrossingFinderTest, NothingOutsideTheVolumeOrBesideTheRegionOrBeforeTheEye) {
  const View view = LookingDown(Projection::kPerspective);
  const auto at_middle = [&](const ClipRegion& region) {
    return ClipCrossingFinder(view, Clipper(region, Geometry())).At(50, 40);
  };
  // Behind the volume, before it, and empty.
  EXPECT_FALSE(at_middle(Planes({{{0, 0, -1}, 21}})).entry.has_value());
  EXPECT_FALSE(at_middle(Planes({{{0, 0, -1}, -21}})).entry.has_value());
  const ClipCrossings none = at_middle(Planes({{{0, 0, 1}, 5}, {{0, 0, -1}, -4}}));
  EXPECT_FALSE(none.entry.has_value() || none.exit.has_value());
  // Parallel to the ray, on its side and on the other one.
  EXPECT_FALSE(at_middle(Planes({{{1, 0, 0}, 1}, {{0, 0, -1}, 0}})).entry.has_value());
  EXPECT_TRUE(at_middle(Planes({{{1, 0, 0}, -1}, {{0, 0, -1}, 0}})).entry.has_value());

  Camera inside;
  inside.eye = {0, 0, 3};
  inside.target = {0, 0, -1};
  inside.up = {0, 1, 0};
  inside.fov_y_radians = 1;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View from_inside, View::Make(inside, {100, 80}, Geometry()));
  const ClipRegion slab = Planes({{{0, 0, 1}, -5}, {{0, 0, -1}, -8}});
  const ClipCrossings crossings =
      ClipCrossingFinder(from_inside, Clipper(slab, Geometry())).At(50, 40);
  EXPECT_FALSE(crossings.entry.has_value()) << "it lies behind the eye";
  EXPECT_TRUE(crossings.exit.has_value());
}

TEST(ClipCrossingFinderTest, ABoxOnTheVolumesBorderCutsIt) {
  const View view = LookingDown(Projection::kPerspective);
  const ClipRegion whole{.half_spaces = {}, .box = Geometry().Bounds()};
  const ClipCrossingFinder finder(view, Clipper(whole, Geometry()));
  int count = 0;
  for (int y = 0; y < 80; ++y) {
    for (int x = 0; x < 100; ++x) {
      const ClipCrossings crossings = finder.At(x + 0.5, y + 0.5);
      EXPECT_EQ(crossings.entry.has_value(), crossings.exit.has_value());
      count += crossings.entry.has_value() ? 1 : 0;
    }
  }
  EXPECT_GT(count, 2000);
}

TEST(ClipCrossingFinderTest, NoRayPassesBetweenTheBordersOfARegion) {
  // Planes through a common edge in front of the volume's middle: each ray that reaches the region
  // enters it.
  const View view = LookingDown(Projection::kOrthographic);
  const ClipRegion wedge = Planes({{{1, 0, -3}, -10}, {{-1, 0.01, -3}, -10}});
  const ClipCrossingFinder finder(view, Clipper(wedge, Geometry()));
  for (int y = 1; y < 79; ++y) {
    for (double x = 49; x < 51; x += 0.01) {
      ASSERT_TRUE(finder.At(x, y).entry.has_value()) << x << ", " << y;
    }
  }
}

TEST(ClipCrossingFinderTest, ARegionHasTheWholesCrossings) {
  const ClipRegion tilted = Planes({{{1, 2, -4}, -3}});
  const Clipper clipper(tilted, Geometry());
  const ClipCrossingFinder whole(LookingDown(Projection::kPerspective), clipper);
  const ClipCrossingFinder part(LookingDown(Projection::kPerspective, Region{30, 20, 11, 7}),
                                clipper);
  const ClipCrossings a = whole.At(35.5, 21.5);
  const ClipCrossings b = part.At(35.5, 21.5);
  ASSERT_TRUE(a.entry && b.entry);
  EXPECT_EQ(a.entry->position, b.entry->position);
  EXPECT_EQ(a.entry->depth, b.entry->depth);
}

}  // namespace
}  // namespace isoscope::view
