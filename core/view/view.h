// A camera made concrete for one volume and one viewport: matrices, clip planes, and where a block
// falls on the screen. Every agent computes the same numbers from the same request.

#ifndef ISOSCOPE_CORE_VIEW_VIEW_H_
#define ISOSCOPE_CORE_VIEW_VIEW_H_

#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/view/camera.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::view {

// Pixels [begin_x, end_x) x [begin_y, end_y), row 0 at the top, inside the viewport.
struct PixelRect {
  int begin_x = 0;
  int begin_y = 0;
  int end_x = 0;
  int end_y = 0;

  [[nodiscard]] bool empty() const { return begin_x >= end_x || begin_y >= end_y; }
  friend bool operator==(const PixelRect&, const PixelRect&) = default;
};

// Where a block can appear.
struct Footprint {
  // Every pixel whose centre a triangle of the block can cover; rounded outward, cut at the
  // viewport. The whole viewport if the block reaches in front of the near plane. Empty: the block
  // can't be seen (outside the frustum).
  PixelRect rect;
  // A window depth that no fragment of the block is nearer than: renderers clamp fragments to
  // [nearest_depth, 1], so that rounding in interpolation can't break this (docs/numerics.md).
  float nearest_depth = 0;
};

// Immutable; thread-safe.
class View {
 public:
  // INVALID_ARGUMENT if camera, viewport or geometry do not validate.
  static absl::StatusOr<View> Make(const Camera& camera, const Viewport& viewport,
                                   const volume::GridGeometry& geometry);

  [[nodiscard]] const Camera& camera() const { return camera_; }
  [[nodiscard]] const Viewport& viewport() const { return viewport_; }
  [[nodiscard]] const volume::GridGeometry& geometry() const { return geometry_; }
  // OpenGL's clip space: -w <= x, y, z <= w; y up; z = -w at the near plane.
  [[nodiscard]] const math::Mat4d& clip_from_world() const { return clip_from_world_; }
  [[nodiscard]] const math::Mat4d& clip_from_index() const { return clip_from_index_; }
  [[nodiscard]] const math::Mat4d& world_from_index() const { return world_from_index_; }
  [[nodiscard]] const math::Mat4d& index_from_world() const { return index_from_world_; }
  // Distances along the view direction; they fit the volume's bounding box, 0 < near < far for
  // perspective.
  [[nodiscard]] double near_distance() const { return near_distance_; }
  [[nodiscard]] double far_distance() const { return far_distance_; }
  // Unit, world space, from the eye to the target; and the camera's unit right and true up.
  [[nodiscard]] const math::Vec3d& forward() const { return forward_; }
  [[nodiscard]] const math::Vec3d& right() const { return right_; }
  [[nodiscard]] const math::Vec3d& up() const { return up_; }

  // The footprint of the box between two positions in index space (samples). Thread-safe; pure.
  [[nodiscard]] Footprint FootprintOf(const math::Vec3d& index_min,
                                      const math::Vec3d& index_max) const;
  // The footprint of a block's cells.
  [[nodiscard]] Footprint FootprintOf(const volume::BlockLayout& layout, volume::BlockId id) const;
  // footprints[i] is FootprintOf(layout, ids[i]), bit for bit; several times as fast for many.
  // REQUIRES: as many footprints as ids.
  void FootprintsOf(const volume::BlockLayout& layout, absl::Span<const volume::BlockId> ids,
                    absl::Span<Footprint> footprints) const;

 private:
  View() = default;

  Camera camera_;
  Viewport viewport_;
  volume::GridGeometry geometry_;
  math::Mat4d world_from_index_;
  math::Mat4d index_from_world_;
  math::Mat4d clip_from_world_;
  math::Mat4d clip_from_index_;
  math::Vec3d forward_;
  math::Vec3d right_;
  math::Vec3d up_;
  double near_distance_ = 0;
  double far_distance_ = 0;
};

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_VIEW_H_
