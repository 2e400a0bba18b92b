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
    : clip_from_index_(view.clip_from_index()) {
  for (int axis = 0; axis < 3; ++axis) {
    last_sample_[axis] = static_cast<double>(view.geometry().sample_dims[axis] - 1);
  }
  const ImagePlane& plane = view.image_plane();
  const math::Vec3d per_x = view.right() * plane.pixel_size;
  const math::Vec3d per_y = view.up() * -plane.pixel_size;
  const math::Vec3d corner = view.right() * (-plane.pixel_size * view.viewport().width_px / 2) +
                             view.up() * plane.half_height;
  Linear<math::Vec3d> world_origin{.at = view.camera().eye, .per_x = {}, .per_y = {}};
  world_direction_ = {.at = view.forward(), .per_x = {}, .per_y = {}};
  Linear<math::Vec3d>& spread = plane.is_perspective ? world_direction_ : world_origin;
  spread = {.at = spread.at + corner, .per_x = per_x, .per_y = per_y};

  const math::Mat4d& to_index = view.index_from_world();
  origin_ = {.at = math::TransformPoint(to_index, world_origin.at),
             .per_x = math::TransformVector(to_index, world_origin.per_x),
             .per_y = math::TransformVector(to_index, world_origin.per_y)};
  direction_ = {.at = math::TransformVector(to_index, world_direction_.at),
                .per_x = math::TransformVector(to_index, world_direction_.per_x),
                .per_y = math::TransformVector(to_index, world_direction_.per_y)};
  for (const HalfSpace& half_space : clipper.half_spaces()) {
    const math::Vec3d& n = half_space.normal;
    approaches_.push_back({.distance = {.at = math::Dot(n, origin_.at) - half_space.offset,
                                        .per_x = math::Dot(n, origin_.per_x),
                                        .per_y = math::Dot(n, origin_.per_y)},
                           .rate = {.at = math::Dot(n, direction_.at),
                                    .per_x = math::Dot(n, direction_.per_x),
                                    .per_y = math::Dot(n, direction_.per_y)}});
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
  ClipCrossing crossing{.position = origin_.At(x, y) + direction_.At(x, y) * t,
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
