// Random views, and what two frames differ in.

#ifndef ISOSCOPE_TESTS_SUPPORT_SCENES_H_
#define ISOSCOPE_TESTS_SUPPORT_SCENES_H_

#include <cstddef>
#include <cstdint>
#include <numbers>

#include "core/base/random.h"
#include "core/image/frame_image.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "partition-agent/frame_request.h"
#include "server/frame_coordinator.h"

namespace isoscope::testing {

// A camera that is inside the volume as often as outside, near and far, turned any way.
inline agent::FrameRequest RandomRequest(std::uint64_t seed, const math::Box3d& bounds,
                                         double isovalue) {
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
  agent::FrameRequest request;
  request.isovalue = isovalue;
  const double radius = bounds.Radius();
  request.camera.target = bounds.Center() + direction() * (0.5 * radius * unit());
  request.camera.eye = request.camera.target + direction() * (radius * (0.02 + 2.5 * unit()));
  request.camera.up = direction();
  if (unit() < 0.5) {
    request.camera.projection = view::Projection::kPerspective;
    request.camera.fov_y_radians = (5 + 110 * unit()) * std::numbers::pi / 180;
  } else {
    request.camera.projection = view::Projection::kOrthographic;
    request.camera.view_height = radius * (0.1 + 2.5 * unit());
  }
  request.viewport = {32 + static_cast<int>(130 * unit()), 32 + static_cast<int>(130 * unit())};
  request.ray_seed = seed;
  return request;
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
    difference.owners += image::BlockOf(a.keys[i]) == image::BlockOf(b.keys[i]) ? 0 : 1;
  }
  return difference;
}

inline std::int64_t CoveredPixels(const image::FrameImage& image) {
  std::int64_t count = 0;
  for (const std::uint64_t key : image.keys) {
    count += image::BlockOf(key) == image::kNoBlock ? 0 : 1;
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
