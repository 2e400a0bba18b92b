// Images made of depths alone, for the tests of effects that use depths.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_PICTURE_DEPTH_SCENE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_PICTURE_DEPTH_SCENE_H_

#include <cstdint>
#include <functional>
#include <optional>

#include "core/image/frame_image.h"
#include "core/view/unprojection.h"
#include "core/view/view.h"
#include "tests/support/status_matchers.h"

namespace isoscope::picture {

inline constexpr std::uint32_t kSceneBlocks = 1000;

// A volume of 100 units on each side, seen along -z: an image of `width` x `height` pixels shows
// its whole height and a little more.
inline view::View MakeSceneView(const view::Viewport& viewport, view::Projection projection,
                                const std::optional<view::Region>& region = std::nullopt) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {101, 101, 101};
  view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
  camera.projection = projection;
  camera.view_height = 120;
  auto view = view::View::Make(camera, viewport, geometry, region);
  ISOSCOPE_EXPECT_OK(view);
  return *view;
}

// The point that a pixel of the whole viewport shows.
struct ScenePoint {
  float depth = 0.5F;  // window depth
  std::uint32_t surface = 0;
  image::Rgba8 color{180, 160, 140, 255};
};
// None: the background. `x` and `y` are pixels of the whole.
using Scene = std::function<std::optional<ScenePoint>(int x, int y)>;

inline image::FrameImage DrawScene(const view::View& view, const Scene& scene) {
  image::FrameImage image(view.region().width_px, view.region().height_px);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (const auto point = scene(view.region().x + x, view.region().y + y)) {
        image.Set(x, y, image::FragmentKey(point->depth, point->surface * kSceneBlocks + 7),
                  point->color);
      }
    }
  }
  return image;
}

// The window depth of a distance along the view axis: the inverse of Unprojection::DistanceOf.
inline float DepthOfDistance(const view::View& view, double distance) {
  const double n = view.near_distance();
  const double f = view.far_distance();
  return static_cast<float>(view.camera().projection == view::Projection::kPerspective
                                ? f * (distance - n) / (distance * (f - n))
                                : (distance - n) / (f - n));
}

// The distance at which the ray of a pixel of the whole meets the plane through `point` with this
// normal, both in camera space: x to the right, y down, z forward.
inline double DistanceToPlane(const view::View& view, int x, int y, const math::Vec3d& point,
                              const math::Vec3d& normal) {
  const view::Camera& camera = view.camera();
  const bool is_perspective = camera.projection == view::Projection::kPerspective;
  const double height =
      is_perspective ? 2 * std::tan(camera.fov_y_radians / 2) : camera.view_height;
  const double pixel = height / view.viewport().height_px;
  const double px = (x + 0.5 - 0.5 * view.viewport().width_px) * pixel;
  const double py = (y + 0.5 - 0.5 * view.viewport().height_px) * pixel;
  const double offset = math::Dot(normal, point);
  return is_perspective ? offset / (normal.x * px + normal.y * py + normal.z)
                        : (offset - normal.x * px - normal.y * py) / normal.z;
}

}  // namespace isoscope::picture

#endif  // ISOSCOPE_TESTS_UNIT_CORE_PICTURE_DEPTH_SCENE_H_
