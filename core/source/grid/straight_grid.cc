// Every invertible matrix M is a rotation, perhaps with a reflection, times a symmetric stretch:
// M = Q S, the polar decomposition. Q is the orthonormal matrix nearest to M. Newton's iteration
// finds it with additions, multiplications and divisions only, so that its bits are the same on all
// machines:
//
//   X(0) = M,   X(k + 1) = (X(k) + inverse transpose of X(k)) / 2
//
// No axis goes before another, as the first would in Gram and Schmidt's method. Source: N. Higham,
// "Computing the polar decomposition - with applications", SIAM J. Sci. Stat. Comput. 7 (1986).

#include "core/source/grid/straight_grid.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "absl/strings/str_format.h"

namespace isoscope::source {

math::Mat3d NearestRightAngles(const math::Mat3d& directions) {
  constexpr int kMaxRounds = 100;      // the least determinant that is valid takes some 25
  constexpr double kEnough = 0x1p-50;  // the next round changes less than a rounding
  math::Mat3d nearest = directions;
  double change = 1;
  for (int round = 0; round < kMaxRounds && change > kEnough; ++round) {
    const math::Mat3d other = math::Transposed(math::Inverted(nearest));
    change = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const math::Vec3d next = (nearest.columns[axis] + other.columns[axis]) * 0.5;
      change = std::max(change, math::Length(next - nearest.columns[axis]));
      nearest.columns[axis] = next;
    }
  }
  return nearest;
}

volume::GridGeometry StraightGrid(const volume::GridGeometry& geometry) {
  volume::GridGeometry straight = geometry;
  math::Mat3d directions = geometry.direction;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double length = math::Length(directions.columns[axis]);
    directions.columns[axis] = directions.columns[axis] * (1 / length);
    straight.spacing[static_cast<int>(axis)] *= length;
  }
  straight.direction = NearestRightAngles(directions);
  return straight;
}

std::string DescribeStraightening(const Shear& shear, const volume::GridGeometry& from,
                                  const volume::GridGeometry& to) {
  double moved = 0;
  for (int corner = 0; corner < 8; ++corner) {
    math::Vec3d index;
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t last = from.sample_dims[axis] - 1;
      index[axis] = (corner >> axis & 1) != 0 ? static_cast<double>(last) : 0;
    }
    moved = std::max(moved, math::Length(math::TransformPoint(from.world_from_index(), index) -
                                         math::TransformPoint(to.world_from_index(), index)));
  }
  return absl::StrFormat(
      "axes %c and %c, which meet at %.4g degrees, were made straight; samples moved by up to %.4g",
      "xyz"[shear.first_axis], "xyz"[shear.second_axis], DegreesOf(shear), moved);
}

}  // namespace isoscope::source
