#include "core/view/clip_crossings.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/math/matrix.h"

namespace isoscope::view {
namespace {

// The distance, in samples, by which rounding may put a crossing outside the volume. A clip box on
// the volume's border still cuts it.
constexpr double kBorderSlack = 1e-6;

}  // namespace

ClipCrossingFinder::ClipCrossingFinder(const View& view, const Clipper& clipper)
    : clip_from_index_(view.clip_from_index()),
      world_direction_(view.image_plane().rays.direction),
      rays_(view.image_plane().rays.TransformedBy(view.index_from_world())) {
  for (int axis = 0; axis < 3; ++axis) {
    last_sample_[axis] = static_cast<double>(view.geometry().sample_dims[axis] - 1);
  }
  for (const HalfSpace& half_space : clipper.half_spaces()) {
    const auto along_normal = [&n = half_space.normal](const LinearVec3d& v) {
      return Linear<double>{math::Dot(n, v.at), math::Dot(n, v.per_x), math::Dot(n, v.per_y)};
    };
    Approach& approach = approaches_.emplace_back(
        Approach{along_normal(rays_.origin), along_normal(rays_.direction)});
    approach.distance.at -= half_space.offset;
  }
}

ClipCrossings ClipCrossingFinder::At(double x, double y) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double entry = -kInfinity;
  double exit = kInfinity;
  std::size_t entered = 0;
  std::size_t left = 0;
  for (std::size_t i = 0; i < approaches_.size(); ++i) {
    const double distance = approaches_[i].distance.At(x, y);
    const double rate = approaches_[i].rate.At(x, y);
    if (rate == 0) {
      if (distance < 0) {
        return {};
      }
      continue;
    }
    const double t = -distance / rate;
    if (rate > 0 && t > entry) {
      entry = t;
      entered = i;
    } else if (rate < 0 && t < exit) {
      exit = t;
      left = i;
    }
  }
  ClipCrossings crossings;
  if (entry <= exit) {
    crossings.entry = CrossingAt(x, y, entry, entered);
    crossings.exit = CrossingAt(x, y, exit, left);
  }
  return crossings;
}

std::optional<ClipCrossing> ClipCrossingFinder::CrossingAt(double x, double y, double t,
                                                           std::size_t half_space) const {
  if (!std::isfinite(t)) {
    return std::nullopt;
  }
  ClipCrossing crossing{.position = rays_.origin.At(x, y) + rays_.direction.At(x, y) * t,
                        .half_space = half_space};
  for (int axis = 0; axis < 3; ++axis) {
    double& p = crossing.position[axis];
    if (!(p >= -kBorderSlack && p <= last_sample_[axis] + kBorderSlack)) {
      return std::nullopt;
    }
    p = std::clamp(p, 0.0, last_sample_[axis]);
  }
  const math::Vec3d& p = crossing.position;
  const math::Vec4d clip = clip_from_index_ * math::Vec4d{p.x, p.y, p.z, 1};
  if (!(clip.w > 0) || !(clip.z >= -clip.w)) {
    return std::nullopt;
  }
  crossing.depth = std::clamp(static_cast<float>(clip.z / clip.w * 0.5 + 0.5), 0.0F, 1.0F) + 0.0F;
  return crossing;
}

}  // namespace isoscope::view
