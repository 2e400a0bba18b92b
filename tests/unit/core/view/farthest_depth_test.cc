// No point of a box is farther than its farthest depth, after the error of a float32 renderer:
// random boxes and cameras against vertices that are projected in float32.

#include "core/view/farthest_depth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

class FarthestNumbers {
 public:
  explicit FarthestNumbers(std::uint64_t seed) : seed_(seed) {}
  double Between(double low, double high) {
    return low + (high - low) * base::RandomUnit(seed_, counter_++);
  }
  math::Vec3d PointBetween(const math::Vec3d& low, const math::Vec3d& high) {
    const double x = Between(low.x, high.x);
    const double y = Between(low.y, high.y);
    return {x, y, Between(low.z, high.z)};
  }

 private:
  const std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

volume::GridGeometry GridOfTest() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {65, 33, 49};
  geometry.spacing = {0.5, 1, 0.75};
  geometry.origin = {-3, 10, 100};
  return geometry;
}

// The window depth that a float32 renderer gives to a vertex.
float DepthInFloats(const math::Mat4d& m, const math::Vec3d& p) {
  const std::array<float, 4> at = {static_cast<float>(p.x), static_cast<float>(p.y),
                                   static_cast<float>(p.z), 1.0F};
  float z = 0;
  float w = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    z += static_cast<float>(m.m[4 * k + 2]) * at[k];
    w += static_cast<float>(m.m[4 * k + 3]) * at[k];
  }
  return std::clamp(z / w * 0.5F + 0.5F, 0.0F, 1.0F);
}

TEST(FarthestDepthTest, NoVertexOfABoxIsFartherInFloat32) {
  const volume::GridGeometry geometry = GridOfTest();
  const math::Vec3d last{64, 32, 48};
  FarthestNumbers random(11);
  int on_screen = 0;
  for (int n = 0; n < 4000; ++n) {
    Camera camera = MakeDefaultCamera(geometry.Bounds());
    camera.eye = geometry.Bounds().Center() +
                 random.PointBetween({-1, -1, -1}, {1, 1, 1}) * std::exp2(random.Between(2, 12));
    if (n % 3 == 0) {
      camera.projection = Projection::kOrthographic;
      camera.view_height = std::exp2(random.Between(-2, 8));
    }
    const absl::StatusOr<View> view = View::Make(camera, {640, 480}, geometry);
    if (!view.ok()) {
      continue;
    }
    const math::Vec3d min = random.PointBetween({0, 0, 0}, last - math::Vec3d{8, 8, 8});
    const math::Vec3d max = min + random.PointBetween({0, 0, 0}, {8, 8, 8});
    const Footprint footprint = view->FootprintOf(min, max);
    if (footprint.rect.empty()) {
      continue;
    }
    const float farthest = FarthestDepthOf(*view, min, max, footprint);
    ASSERT_GE(farthest, footprint.nearest_depth);
    ASSERT_LE(farthest, 1);
    if (footprint.nearest_depth == 0) {
      ASSERT_EQ(farthest, 1);
      continue;
    }
    ++on_screen;
    double exact = 0;
    for (const math::Vec3d& corner : math::Box3d{min, max}.Corners()) {
      ASSERT_LE(DepthInFloats(view->clip_from_index(), corner), farthest) << "box " << n;
      const math::Vec4d clip =
          view->clip_from_index() * math::Vec4d{corner.x, corner.y, corner.z, 1};
      exact = std::max(exact, clip.z / clip.w * 0.5 + 0.5);
    }
    for (int i = 0; i < 20; ++i) {
      ASSERT_LE(DepthInFloats(view->clip_from_index(), random.PointBetween(min, max)), farthest);
    }
    // It is a bound of rounding errors, and no more.
    ASSERT_GE(farthest, exact);
    ASSERT_LE(farthest, exact + 1e-3);
  }
  EXPECT_GT(on_screen, 1000);
}

TEST(FarthestDepthTest, ABoxAtTheEyeReachesTheFarPlane) {
  const volume::GridGeometry geometry = GridOfTest();
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  camera.eye = geometry.Bounds().Center();
  camera.target = camera.eye + math::Vec3d{1, 0.5, 0.25};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {64, 64}, geometry));
  const math::Vec3d min{30, 14, 22};
  const math::Vec3d max{34, 18, 26};
  const Footprint footprint = view.FootprintOf(min, max);
  ASSERT_EQ(footprint.nearest_depth, 0);
  EXPECT_EQ(FarthestDepthOf(view, min, max, footprint), 1);
}

}  // namespace
}  // namespace isoscope::view
