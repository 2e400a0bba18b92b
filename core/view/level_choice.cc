// The nearest point, in the index space of level 0:
//
// 1. The volume is a box there, and the clip box is a parallelepiped. Their intersection is convex.
//    Its corners are those of the faces of each, cut by the half-spaces of the other.
// 2. The distance from the eye along the view direction is linear, so its extremes are at corners.
// 3. The nearest point is the nearest corner, but not nearer than the near plane.
//
// Half-spaces are moved out by a margin of rounding. Without one, a clip box that equals the volume
// could leave nothing of it.

#include "core/view/level_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "core/math/matrix.h"
#include "core/view/clip_region.h"

namespace isoscope::view {
namespace {

using Polygon = std::vector<math::Vec3d>;

// Moves the border of a half-space by this part of its largest terms.
constexpr double kMargin = 1e-9;

math::Vec3d LastSample(const volume::GridGeometry& grid) {
  return {static_cast<double>(grid.sample_dims.x - 1), static_cast<double>(grid.sample_dims.y - 1),
          static_cast<double>(grid.sample_dims.z - 1)};
}

// The faces of a box whose corners are transformed by a matrix.
std::vector<Polygon> FacesOf(const math::Box3d& box, const math::Mat4d& matrix) {
  std::vector<Polygon> faces;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    for (const math::Vec3d& side : {box.min, box.max}) {
      Polygon& face = faces.emplace_back();
      constexpr std::array<std::array<bool, 2>, 4> kCorners{
          {{false, false}, {true, false}, {true, true}, {false, true}}};
      for (const std::array<bool, 2>& corner : kCorners) {
        math::Vec3d point = side;
        point[u] = corner[0] ? box.max[u] : box.min[u];
        point[v] = corner[1] ? box.max[v] : box.min[v];
        face.push_back(math::TransformPoint(matrix, point));
      }
    }
  }
  return faces;
}

// Half-spaces of index space that hold the volume.
std::vector<HalfSpace> HalfSpacesOf(const math::Vec3d& last_sample) {
  std::vector<HalfSpace> half_spaces;
  for (int axis = 0; axis < 3; ++axis) {
    HalfSpace lower;
    lower.normal[axis] = 1;
    HalfSpace upper;
    upper.normal[axis] = -1;
    upper.offset = -last_sample[axis];
    half_spaces.push_back(lower);
    half_spaces.push_back(upper);
  }
  return half_spaces;
}

// Sutherland and Hodgman 1974. A point within the margin is inside.
Polygon Cut(const Polygon& polygon, const HalfSpace& half_space, const math::Vec3d& last_sample) {
  double margin = std::abs(half_space.offset);
  for (int axis = 0; axis < 3; ++axis) {
    margin += std::abs(half_space.normal[axis]) * last_sample[axis];
  }
  margin *= kMargin;
  const auto distance_of = [&](const math::Vec3d& p) {
    return math::Dot(half_space.normal, p) - half_space.offset + margin;
  };
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const math::Vec3d& from = polygon[i];
    const math::Vec3d& to = polygon[(i + 1) % polygon.size()];
    const double a = distance_of(from);
    const double b = distance_of(to);
    if (a >= 0) {
      kept.push_back(from);
    }
    if ((a >= 0) != (b >= 0)) {
      kept.push_back(from + (to - from) * (a / (a - b)));
    }
  }
  return kept;
}

// The least and the greatest distance from the eye; the least is above the greatest if there is no
// point.
struct Distances {
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = -std::numeric_limits<double>::infinity();
};

void Add(std::vector<Polygon> faces, std::span<const HalfSpace> half_spaces, const View& view,
         Distances* distances) {
  const math::Vec3d last_sample = LastSample(view.geometry());
  for (Polygon& face : faces) {
    for (const HalfSpace& half_space : half_spaces) {
      face = Cut(face, half_space, last_sample);
    }
    for (const math::Vec3d& corner : face) {
      const math::Vec3d point = math::TransformPoint(view.world_from_index(), corner);
      const double distance = math::Dot(point - view.camera().eye, view.forward());
      distances->nearest = std::min(distances->nearest, distance);
      distances->farthest = std::max(distances->farthest, distance);
    }
  }
}

// Moves sides that lie far from the volume nearer to it, so that no transform overflows.
math::Box3d WithinReach(const math::Box3d& clip_box, const math::Box3d& bounds) {
  math::Box3d box;
  for (int axis = 0; axis < 3; ++axis) {
    const double size = bounds.max[axis] - bounds.min[axis];
    const double least = bounds.min[axis] - size;
    const double greatest = bounds.max[axis] + size;
    box.min[axis] = std::clamp(clip_box.min[axis], least, greatest);
    box.max[axis] = std::clamp(clip_box.max[axis], least, greatest);
  }
  return box;
}

Distances DistancesOf(const View& view, std::optional<math::Box3d> clip_box) {
  if (clip_box.has_value()) {
    clip_box = WithinReach(*clip_box, view.geometry().Bounds());
  }
  const math::Vec3d last_sample = LastSample(view.geometry());
  Distances distances;
  const Clipper clipper({.half_spaces = {}, .box = clip_box}, view.geometry());
  Add(FacesOf({{0, 0, 0}, last_sample}, math::Mat4d()), clipper.half_spaces(), view, &distances);
  if (clip_box.has_value()) {
    Add(FacesOf(*clip_box, view.index_from_world()), HalfSpacesOf(last_sample), view, &distances);
  }
  return distances;
}

}  // namespace

double PixelsPerUnit(const View& view, const std::optional<math::Box3d>& clip_box) {
  const Distances distances = DistancesOf(view, clip_box);
  if (!(distances.farthest >= view.near_distance())) {
    return 0;
  }
  const ImagePlane& plane = view.image_plane();
  const double nearest = std::max(distances.nearest, view.near_distance());
  return 1 / (plane.is_perspective ? plane.pixel_size * nearest : plane.pixel_size);
}

math::Vec3d WorldSpacing(const volume::GridGeometry& grid) {
  math::Vec3d spacing;
  for (int axis = 0; axis < 3; ++axis) {
    spacing[axis] =
        math::Length(grid.direction.columns[static_cast<std::size_t>(axis)]) * grid.spacing[axis];
  }
  return spacing;
}

double SpacingPx(const volume::GridGeometry& grid, double pixels_per_unit) {
  const math::Vec3d spacing = WorldSpacing(grid);
  return std::max({spacing.x, spacing.y, spacing.z}) * pixels_per_unit;
}

int CoarsestLevel(const volume::GridGeometry& grid, double pixels_per_unit, double max_spacing_px,
                  int highest_level) {
  double spacing_px = SpacingPx(grid, pixels_per_unit);
  int level = 0;
  while (level < highest_level && 2 * spacing_px <= max_spacing_px) {
    spacing_px *= 2;
    ++level;
  }
  return level;
}

}  // namespace isoscope::view
