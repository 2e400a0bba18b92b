#include "core/render/surface_point.h"

#include <cmath>

#include "gtest/gtest.h"

#include "core/render/shade_kernel.h"
#include "tests/unit/core/render/test_scenes.h"

namespace isoscope::render {
namespace {

Scene EmptyScene() {
  return MakeIsosurface(65, 8, [](const math::Vec3d&) { return -1.0; });
}

TEST(SurfacePointTest, ThePointLiesOnTheTriangleBehindThePixelsCentre) {
  const Scene scene = EmptyScene();
  // 64 pixels show 64 samples.
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  const MeshPtr mesh = MakeTriangle(0, {0, 0, 30}, {64, 0, 30}, {0, 64, 30}, {0, 0, 1});
  const SurfacePoint point = SurfacePointAt(view, *mesh, 0, 10, 50);
  EXPECT_NEAR(point.position.x, 10.5, 1e-5);
  EXPECT_NEAR(point.position.y, 64 - 50.5, 1e-5);
  EXPECT_NEAR(point.position.z, 30, 1e-5);
  EXPECT_EQ(ShadeStepAt(view, point), kShadeSteps) << "it faces the eye";
}

TEST(SurfacePointTest, TheStepIsTheCosineToTheEye) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  const float c = std::sqrt(0.5F);
  const MeshPtr tilted = MakeTriangle(0, {0, 0, 30}, {64, 0, 30}, {0, 64, 30}, {c, 0, c});
  EXPECT_NEAR(ShadeStepAt(view, SurfacePointAt(view, *tilted, 0, 10, 50)),
              kShadeSteps * std::sqrt(0.5), 1);
  const MeshPtr none = MakeTriangle(0, {0, 0, 30}, {64, 0, 30}, {0, 64, 30}, {0, 0, 0});
  EXPECT_EQ(ShadeStepAt(view, SurfacePointAt(view, *none, 0, 10, 50)), kShadeSteps)
      << "as if it faced the eye";
}

}  // namespace
}  // namespace isoscope::render
