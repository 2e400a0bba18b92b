// The nearest point of a triangle is the foot of the perpendicular, if that lies inside. Else it is
// the nearest of the nearest points of its three sides.

#include "core/mesh/mesh_point.h"

#include <algorithm>
#include <cstddef>

namespace isoscope::mesh {
namespace {

using Corners = std::array<math::Vec3d, 3>;  // relative to the position

// Returns the weights of the foot of the perpendicular from the origin; not set if it lies outside,
// or if the triangle has no area.
std::optional<std::array<double, 3>> WeightsInside(const Corners& corners) {
  const math::Vec3d normal = math::Cross(corners[1] - corners[0], corners[2] - corners[0]);
  const double squared_length = math::Dot(normal, normal);
  if (!(squared_length > 0)) {
    return std::nullopt;
  }
  const double second = math::Dot(math::Cross(corners[2], corners[0]), normal) / squared_length;
  const double third = math::Dot(math::Cross(corners[0], corners[1]), normal) / squared_length;
  const double first = 1 - second - third;
  if (first < 0 || second < 0 || third < 0) {
    return std::nullopt;
  }
  return std::array<double, 3>{first, second, third};
}

math::Vec3d Mixed(const Corners& corners, const std::array<double, 3>& weights) {
  return corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
}

std::array<double, 3> NearestOnSide(const Corners& corners, std::size_t side) {
  const std::size_t next = (side + 1) % 3;
  const math::Vec3d along = corners[next] - corners[side];
  const double squared_length = math::Dot(along, along);
  const double t = squared_length > 0
                       ? std::clamp(-math::Dot(corners[side], along) / squared_length, 0.0, 1.0)
                       : 0.0;
  std::array<double, 3> weights{};
  weights[side] = 1 - t;
  weights[next] = t;
  return weights;
}

}  // namespace

std::optional<MeshPoint> NearestPoint(const BlockMeshView& mesh, const math::Vec3d& position) {
  std::optional<MeshPoint> nearest;
  for (std::size_t first = 0; first + 3 <= mesh.indices.size(); first += 3) {
    const std::array<std::uint32_t, 3> vertices = {mesh.indices[first], mesh.indices[first + 1],
                                                   mesh.indices[first + 2]};
    Corners corners;
    for (std::size_t i = 0; i < 3; ++i) {
      const math::Vec3f& p = mesh.positions[vertices[i]];
      const math::Vec3d corner{static_cast<double>(p.x), static_cast<double>(p.y),
                               static_cast<double>(p.z)};
      corners[i] = corner - position;
    }
    const auto take = [&](const std::array<double, 3>& weights) {
      const math::Vec3d point = Mixed(corners, weights);
      const double squared_distance = math::Dot(point, point);
      if (!nearest.has_value() || squared_distance < nearest->squared_distance) {
        nearest = {vertices, weights, squared_distance};
      }
    };
    if (const auto inside = WeightsInside(corners); inside.has_value()) {
      take(*inside);
      continue;
    }
    for (std::size_t side = 0; side < 3; ++side) {
      take(NearestOnSide(corners, side));
    }
  }
  return nearest;
}

double ValueAt(const VertexValues& values, const MeshPoint& point) {
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    if (point.weights[i] > 0) {
      sum += point.weights[i] * values[point.vertices[i]];
    }
  }
  return sum;
}

}  // namespace isoscope::mesh
