// Axis-aligned boxes: of integers (half-open) and of reals (closed).

#ifndef ISOSCOPE_CORE_MATH_BOX_H_
#define ISOSCOPE_CORE_MATH_BOX_H_

#include <algorithm>
#include <array>
#include <limits>

#include "core/math/vec.h"

namespace isoscope::math {

// The positions p with begin <= p < end on each axis.
struct IndexBox {
  Index3 begin;
  Index3 end;

  [[nodiscard]] constexpr Index3 dims() const { return end - begin; }
  [[nodiscard]] constexpr bool Contains(const Index3& p) const {
    return p.x >= begin.x && p.x < end.x && p.y >= begin.y && p.y < end.y && p.z >= begin.z &&
           p.z < end.z;
  }
  [[nodiscard]] constexpr bool empty() const {
    return begin.x >= end.x || begin.y >= end.y || begin.z >= end.z;
  }
  // True for an empty box, too.
  [[nodiscard]] constexpr bool Covers(const IndexBox& box) const {
    return box.empty() || (Contains(box.begin) && Contains(box.end - Index3{1, 1, 1}));
  }
  // Becomes the least box around both; an empty one adds nothing.
  constexpr void Add(const IndexBox& box) {
    if (box.empty()) {
      return;
    }
    if (empty()) {
      *this = box;
      return;
    }
    for (int axis = 0; axis < 3; ++axis) {
      begin[axis] = std::min(begin[axis], box.begin[axis]);
      end[axis] = std::max(end[axis], box.end[axis]);
    }
  }
  friend constexpr bool operator==(const IndexBox&, const IndexBox&) = default;
};

// The points p with min <= p <= max on each axis; empty until a point is added.
struct Box3d {
  Vec3d min{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
            std::numeric_limits<double>::infinity()};
  Vec3d max{-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
            -std::numeric_limits<double>::infinity()};

  void Add(const Vec3d& p) {
    for (int axis = 0; axis < 3; ++axis) {
      min[axis] = std::min(min[axis], p[axis]);
      max[axis] = std::max(max[axis], p[axis]);
    }
  }
  [[nodiscard]] constexpr Vec3d Center() const { return (min + max) * 0.5; }
  // Half of the diagonal.
  [[nodiscard]] double Radius() const { return 0.5 * Length(max - min); }
  // x varies fastest.
  [[nodiscard]] constexpr std::array<Vec3d, 8> Corners() const {
    std::array<Vec3d, 8> corners;
    for (std::size_t i = 0; i < 8; ++i) {
      corners[i] = {(i & 1) != 0 ? max.x : min.x, (i & 2) != 0 ? max.y : min.y,
                    (i & 4) != 0 ? max.z : min.z};
    }
    return corners;
  }
  friend constexpr bool operator==(const Box3d&, const Box3d&) = default;
};

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_BOX_H_
