#include "core/view/unprojection.h"

#include <cmath>
#include <cstdint>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

volume::GridGeometry MakeGeometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {65, 33, 49};
  geometry.spacing = {0.5, 1, 0.75};
  geometry.origin = {-3, 10, 100};
  return geometry;
}

Camera MakeCamera(Projection projection) {
  Camera camera = MakeDefaultCamera(MakeGeometry().Bounds());
  Azimuth(0.7, &camera);
  Elevation(-0.4, &camera);
  OrthogonalizeUp(&camera);
  camera.projection = projection;
  return camera;
}

// Projects a point to pixel and window depth. The inverse must give the point again.
TEST(UnprojectionTest, AProjectedPointComesBack) {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    const Region region{200, 100, 300, 200};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const View view, View::Make(MakeCamera(projection), {640, 480}, MakeGeometry(), region));
    const Unprojection unprojection(view);
    const math::Box3d bounds = MakeGeometry().Bounds();
    for (std::uint64_t i = 0; i < 1000; ++i) {
      const auto unit = [&](std::uint64_t k) { return base::RandomUnit(9, 3 * i + k); };
      const math::Vec3d size = bounds.max - bounds.min;
      const math::Vec3d p =
          bounds.min + math::Vec3d{size.x * unit(0), size.y * unit(1), size.z * unit(2)};
      const double distance = math::Dot(p - view.camera().eye, view.forward());
      const math::Vec4d clip = view.clip_from_world() * math::Vec4d{p.x, p.y, p.z, 1};
      const auto depth = static_cast<float>(0.5 * clip.z / clip.w + 0.5);
      // float32 of the window depth: coarse far away in perspective.
      const double tolerance = projection == Projection::kPerspective ? 1e-3 : 1e-4;
      ASSERT_NEAR(static_cast<double>(unprojection.DistanceOf(depth)), distance, tolerance);
      // The point at the pixel's centre is at most half a pixel's diagonal away.
      const int x = static_cast<int>(std::floor(320 * (clip.x / clip.w + 1))) - region.x;
      const int y = static_cast<int>(std::floor(240 * (1 - clip.y / clip.w))) - region.y;
      const math::Vec3d back = unprojection.PositionOf(x, y, static_cast<float>(distance));
      const math::Vec3d next = unprojection.PositionOf(x + 1, y + 1, static_cast<float>(distance));
      ASSERT_LE(math::Length(back - p), 0.51 * math::Length(next - back) + 1e-4);
    }
  }
}

TEST(UnprojectionTest, DepthsZeroAndOneAreTheClipPlanes) {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view,
                                  View::Make(MakeCamera(projection), {64, 48}, MakeGeometry()));
    const Unprojection unprojection(view);
    EXPECT_FLOAT_EQ(unprojection.DistanceOf(0), static_cast<float>(view.near_distance()));
    EXPECT_FLOAT_EQ(unprojection.DistanceOf(1), static_cast<float>(view.far_distance()));
  }
}

TEST(UnprojectionTest, ACoordinateIsThePositionsToTheBit) {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view,
                                  View::Make(MakeCamera(projection), {640, 480}, MakeGeometry()));
    const Unprojection unprojection(view);
    for (int i = 0; i < 100; ++i) {
      const float distance = 20 + 0.37F * static_cast<float>(i);
      const math::Vec3d p = unprojection.PositionOf(6 * i, 4 * i + 3, distance);
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(unprojection.CoordinateOf(axis, 6 * i, 4 * i + 3, distance), p[axis]);
      }
    }
  }
}

TEST(UnprojectionTest, ThePointOfAPixelLiesOnItsRay) {
  const Region region{17, 400, 50, 60};
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const View view, View::Make(MakeCamera(projection), {640, 480}, MakeGeometry(), region));
    const PixelRays& rays = view.image_plane().rays;
    const PixelRays index_rays = rays.TransformedBy(view.index_from_world());
    for (int i = 0; i < 50; ++i) {
      const math::Vec3d p = Unprojection(view).PositionOf(i, 2 * i, 90);
      const double x = region.x + i + 0.5;
      const double y = region.y + 2 * i + 0.5;
      EXPECT_LE(math::Length(rays.origin.At(x, y) + rays.direction.At(x, y) * 90.0 - p), 1e-9);
      EXPECT_LE(math::Length(index_rays.origin.At(x, y) + index_rays.direction.At(x, y) * 90.0 -
                             math::TransformPoint(view.index_from_world(), p)),
                1e-9);
    }
  }
}

TEST(UnprojectionTest, ARegionsPixelIsTheWholesToTheBit) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View whole, View::Make(MakeCamera(Projection::kPerspective),
                                                             {640, 480}, MakeGeometry()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const View part, View::Make(MakeCamera(Projection::kPerspective), {640, 480}, MakeGeometry(),
                                  Region{17, 400, 50, 60}));
  const math::Vec3d a = Unprojection(whole).PositionOf(20, 409, 90);
  const math::Vec3d b = Unprojection(part).PositionOf(3, 9, 90);
  EXPECT_EQ(a, b);
}

}  // namespace
}  // namespace isoscope::view
