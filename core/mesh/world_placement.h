// Where the vertices of a mesh lie in the world, and with which digits.
//
// A float32 tells vertices apart as long as its step, at the largest coordinate of the volume, is
// small beside the distance of two samples. Far from the origin it is not: at 4 600 000 the step is
// 0.5. There a mesh has an origin of its own, and float32 offsets from it. World positions are the
// sums, in double (docs/export.md, "Far from the origin").

#ifndef ISOSCOPE_CORE_MESH_WORLD_PLACEMENT_H_
#define ISOSCOPE_CORE_MESH_WORLD_PLACEMENT_H_

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::mesh {

// Immutable; thread-safe.
class WorldPlacement {
 public:
  // REQUIRES: volume::Validate is OK.
  explicit WorldPlacement(const volume::GridGeometry& geometry);

  // True if the mesh has an origin of its own: if the step of float32 at the largest coordinate of
  // the volume's corners exceeds kLargestStep of the least distance between neighbouring samples,
  // and 4 times the step of float32 at the largest index.
  [[nodiscard]] bool has_origin() const { return has_origin_; }
  static constexpr double kLargestStep = 0x1.0p-10;
  // World units: near the lowest corner of the volume's box, with few decimal digits; or (0, 0, 0).
  [[nodiscard]] const math::Vec3d& origin() const { return origin_; }

  // Takes a position in index space to its offset from origin().
  [[nodiscard]] math::Vec3f OffsetOf(const math::Vec3f& position) const;
  // Takes it to the world: the position that a file has.
  [[nodiscard]] math::Vec3d PositionOf(const math::Vec3f& position) const;

  // Returns where the vertex lies, as far as it tells vertices apart: PositionOf, or the position
  // itself if blur() is 0.
  [[nodiscard]] math::Vec3d PlaceOf(const math::Vec3f& position) const;

  // Positions of one PositionOf are at most this far apart on each axis of index space. 0: the
  // grid has so many samples on an axis, or is so sheared, that it is not known to be below 1/8.
  [[nodiscard]] double blur() const { return blur_; }

 private:
  math::Vec3d origin_;
  bool has_origin_ = false;
  math::Mat4d offset_from_index_;
  double blur_ = 0;
};

// The distance from a float32 of this size to the next larger one. REQUIRES: size >= 0, finite.
double StepOfFloat32(double size);

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_WORLD_PLACEMENT_H_
