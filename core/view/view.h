// The view of one volume through one camera on one viewport: matrices, clip planes, and the pixels
// that a block can cover. Every agent computes the same bits from the same request.

#ifndef ISOSCOPE_CORE_VIEW_VIEW_H_
#define ISOSCOPE_CORE_VIEW_VIEW_H_

#include <array>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/view/camera.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::view {

// Pixels [begin_x, end_x) x [begin_y, end_y) of the picture, row 0 at the top. The picture is the
// viewport, or the region of it that the view shows.
struct PixelRect {
  int begin_x = 0;
  int begin_y = 0;
  int end_x = 0;
  int end_y = 0;

  [[nodiscard]] bool empty() const { return begin_x >= end_x || begin_y >= end_y; }
  friend bool operator==(const PixelRect&, const PixelRect&) = default;
};

// The pixels and depths at which a block can appear.
struct Footprint {
  // Holds every pixel whose centre a triangle of the block can cover: rounded outward, clipped to
  // the picture. It is the whole picture if the block reaches the near plane, and empty if the
  // block is outside the frustum.
  PixelRect rect;
  // The least window depth of a fragment of the block. Renderers clamp fragments to
  // [nearest_depth, 1], so that rounding in interpolation can't break this (docs/numerics.md).
  float nearest_depth = 0;
};

// A value that is linear over the picture. (x, y) count pixels of the whole viewport: the centre of
// its first pixel is (0.5, 0.5).
template <typename T>
struct Linear {
  [[nodiscard]] T At(double x, double y) const { return at + per_x * x + per_y * y; }

  T at{};
  T per_x{};
  T per_y{};
};
using LinearVec3d = Linear<math::Vec3d>;
using LinearVec3f = Linear<std::array<float, 3>>;
// Rounds each number.
LinearVec3f ToFloats(const LinearVec3d& value);

// The rays through the pixels. They start in the plane through the eye that is perpendicular to the
// view direction. Directions have length 1 along the view direction, in world units.
struct PixelRays {
  LinearVec3d origin;
  LinearVec3d direction;

  // Returns the rays in the space to which an affine matrix transforms.
  [[nodiscard]] PixelRays TransformedBy(const math::Mat4d& m) const;
};

// The rectangle of world space that the whole viewport shows, perpendicular to the view direction:
// at distance 1 from the eye for perspective, at any for orthographic. Lengths in world units.
struct ImagePlane {
  bool is_perspective = true;
  double half_width = 0;
  double half_height = 0;
  double pixel_size = 0;  // of a pixel's side: pixels are squares
  PixelRays rays;         // world space
};

// Immutable; thread-safe.
class View {
 public:
  // Makes the view of a volume. INVALID_ARGUMENT if camera, viewport, region or geometry do not
  // validate, or if float32 does not hold their projection. A region changes no matrix: its pixels
  // are those of the whole.
  static absl::StatusOr<View> Make(const Camera& camera, const Viewport& viewport,
                                   const volume::GridGeometry& geometry,
                                   const std::optional<Region>& region = std::nullopt);
  // Returns this view of another grid, such as a level of the volume: the same picture of the world,
  // with the same clip planes. `grid` must lie within the bounds of geometry(). INVALID_ARGUMENT as
  // Make.
  [[nodiscard]] absl::StatusOr<View> OnGrid(const volume::GridGeometry& grid) const;

  [[nodiscard]] const Camera& camera() const { return camera_; }
  // The whole, also if the picture is a region of it.
  [[nodiscard]] const Viewport& viewport() const { return viewport_; }
  // The picture, in pixels of the whole. Pixel (x, y) of the picture is pixel (x + region().x,
  // y + region().y) of the whole.
  [[nodiscard]] const Region& region() const { return region_; }
  [[nodiscard]] Viewport image_size() const { return {region_.width_px, region_.height_px}; }
  [[nodiscard]] bool is_whole() const { return image_size() == viewport_; }
  [[nodiscard]] const volume::GridGeometry& geometry() const { return geometry_; }
  // OpenGL's clip space: -w <= x, y, z <= w; y up; z = -w at the near plane.
  [[nodiscard]] const math::Mat4d& clip_from_world() const { return clip_from_world_; }
  [[nodiscard]] const math::Mat4d& clip_from_index() const { return clip_from_index_; }
  [[nodiscard]] const math::Mat4d& world_from_index() const { return world_from_index_; }
  [[nodiscard]] const math::Mat4d& index_from_world() const { return index_from_world_; }
  // Distances of the clip planes along the view direction. They fit the bounding box of the volume
  // that Make got; 0 < near < far for perspective, 0 <= near < far for orthographic.
  [[nodiscard]] double near_distance() const { return near_distance_; }
  [[nodiscard]] double far_distance() const { return far_distance_; }
  [[nodiscard]] const ImagePlane& image_plane() const { return image_plane_; }
  // Unit vectors in world space: from the eye to the target, and the camera's right and true up.
  [[nodiscard]] const math::Vec3d& forward() const { return forward_; }
  [[nodiscard]] const math::Vec3d& right() const { return right_; }
  [[nodiscard]] const math::Vec3d& up() const { return up_; }

  // Returns the footprint of the box between two positions in index space (samples). Pure.
  [[nodiscard]] Footprint FootprintOf(const math::Vec3d& index_min,
                                      const math::Vec3d& index_max) const;
  // Returns the footprint of a block's cells.
  [[nodiscard]] Footprint FootprintOf(const volume::BlockLayout& layout, volume::BlockId id) const;
  // Sets footprints[i] to FootprintOf(layout, ids[i]), bit for bit, several times as fast for many.
  // REQUIRES: footprints.size() == ids.size().
  void FootprintsOf(const volume::BlockLayout& layout, absl::Span<const volume::BlockId> ids,
                    absl::Span<Footprint> footprints) const;

 private:
  View() = default;

  [[nodiscard]] math::Mat3d EyeRotation() const;
  // Sets the geometry and all matrices, last. Errors as Make.
  absl::Status SetGrid(const volume::GridGeometry& geometry);

  Camera camera_;
  Viewport viewport_;
  Region region_;
  volume::GridGeometry geometry_;
  ImagePlane image_plane_;
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
