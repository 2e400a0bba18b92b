// Random views, and what two frames differ in.

#ifndef ISOSCOPE_TESTS_SUPPORT_SCENES_H_
#define ISOSCOPE_TESTS_SUPPORT_SCENES_H_

#include <cstddef>
#include <cstdint>
#include <numbers>

#include "core/base/random.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::testing {

// A camera that is inside the volume as often as outside, near and far, turned any way.
inline frame::FrameSpec RandomSpec(std::uint64_t seed, const math::Box3d& bounds, double isovalue) {
  std::uint64_t counter = 0;
  const auto unit = [&] { return base::RandomUnit(seed, counter++); };
  const auto signed_unit = [&] { return 2 * unit() - 1; };
  const auto direction = [&] {
    while (true) {
      const math::Vec3d v{signed_unit(), signed_unit(), signed_unit()};
      if (const double length = math::Length(v); length > 0.1 && length <= 1) {
        return v * (1 / length);
      }
    }
  };
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = isovalue}, .appearance = {}}};
  view::Camera& camera = spec.camera.emplace();
  const double radius = bounds.Radius();
  camera.target = bounds.Center() + direction() * (0.5 * radius * unit());
  camera.eye = camera.target + direction() * (radius * (0.02 + 2.5 * unit()));
  camera.up = direction();
  if (unit() < 0.5) {
    camera.projection = view::Projection::kPerspective;
    camera.fov_y_radians = (5 + 110 * unit()) * std::numbers::pi / 180;
  } else {
    camera.projection = view::Projection::kOrthographic;
    camera.view_height = radius * (0.1 + 2.5 * unit());
  }
  spec.viewport = {32 + static_cast<int>(130 * unit()), 32 + static_cast<int>(130 * unit())};
  spec.ray_seed = seed;
  return spec;
}

// Numbers of pixels.
struct Difference {
  std::int64_t colors = 0;
  std::int64_t depths = 0;
  std::int64_t owners = 0;

  friend bool operator==(const Difference&, const Difference&) = default;
};

// REQUIRES: of the same size.
inline Difference Compare(const image::FrameImage& a, const image::FrameImage& b) {
  Difference difference;
  for (std::size_t i = 0; i < a.pixel_count(); ++i) {
    difference.colors += a.colors[i] == b.colors[i] ? 0 : 1;
    difference.depths += image::DepthOf(a.keys[i]) == image::DepthOf(b.keys[i]) ? 0 : 1;
    difference.owners += image::OwnerOf(a.keys[i]) == image::OwnerOf(b.keys[i]) ? 0 : 1;
  }
  return difference;
}

inline std::int64_t CoveredPixels(const image::FrameImage& image) {
  std::int64_t count = 0;
  for (const std::uint64_t key : image.keys) {
    count += image::OwnerOf(key) == image::kNoOwner ? 0 : 1;
  }
  return count;
}

inline std::int64_t TriangleCount(const server::FrameResult& result) {
  std::int64_t count = 0;
  for (const frame::AgentStatistics& agent : result.agents) {
    count += agent.triangle_count;
  }
  return count;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_SCENES_H_
