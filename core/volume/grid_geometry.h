// The position of a regular grid of samples in the world.

#ifndef ISOSCOPE_CORE_VOLUME_GRID_GEOMETRY_H_
#define ISOSCOPE_CORE_VOLUME_GRID_GEOMETRY_H_

#include "absl/status/status.h"

#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"

namespace isoscope::volume {

// world = origin + direction * (spacing * index), index counted in samples, x fastest in memory.
struct GridGeometry {
  math::Index3 sample_dims;      // samples on each axis, >= 2
  math::Vec3d spacing{1, 1, 1};  // world units between samples, > 0
  math::Vec3d origin;            // world position of sample (0, 0, 0)
  math::Mat3d direction;         // columns: world directions of the index axes

  friend bool operator==(const GridGeometry&, const GridGeometry&) = default;

  [[nodiscard]] math::Mat4d world_from_index() const;
  [[nodiscard]] math::Mat4d index_from_world() const;
  // The matrix from index gradients to world gradients: the inverse transpose of the linear part.
  [[nodiscard]] math::Mat3d world_gradient_from_index() const;
  // The world box around all samples.
  [[nodiscard]] math::Box3d Bounds() const;
};

// INVALID_ARGUMENT, with the limit, unless dims are 2 to 2^24 and at most 2^62 in all, numbers are
// finite, direction is invertible, and 32-bit floats carry the positions (limits: the source).
absl::Status Validate(const GridGeometry& geometry);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_GRID_GEOMETRY_H_
