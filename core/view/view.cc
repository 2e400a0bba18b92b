// Makes a view in four steps:
//
//   1. The camera's unit vectors right, up and -forward are the rows of the rotation to eye space.
//   2. eye_from_index is composed directly, not as eye_from_world * world_from_index.
//   3. The clip planes fit the 8 corners of the volume, plus a slack; near is at least 1/1000 of
//      far for perspective, at least 0 for orthographic.
//   4. Projection times both eye matrices gives clip_from_world and clip_from_index (SetGrid). A view
//      on another grid repeats this step alone, with the clip planes of the first one.
//
// A footprint holds, for a box of cells, the pixels that a float32 renderer can cover, and the
// least depth of a fragment. footprint_kernel.cc computes rectangles and depths. Here depths are
// rounded towards the viewer. A box that the kernel gives the whole picture has depth 0, so that it
// is never hidden.
//
// A region only cuts rectangles, and counts their pixels from its own corner. Everything else is
// computed for the whole, so that a region has the pixels of the whole.
//
// Invariant: the same operations in the same order on every agent, in double, without contraction.
//
// Derivation: docs/numerics.md, "Camera" and "How far float32 can move a vertex". Exact culling
// rests on it: "Depth, fragments and exact culling", conditions 2 and 3.

#include "core/view/view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/math/elementary.h"
#include "core/view/footprint_kernel.h"

namespace isoscope::view {
namespace {

// The near plane is at least this part of the far distance (VTK's choice for deep buffers): at the
// far end one step of a 32-bit float depth is then 6e-5 of the far distance, less than a cell.
constexpr double kMinNearFraction = 1e-3;
// The planes keep a distance from the volume, so that nothing on its boundary is clipped: by this
// fraction of its depth, plus this fraction of its distance for the error of float32 clip
// coordinates (kClipError, with room to spare).
constexpr double kPlaneSlack = 1e-3;
constexpr double kPlaneRoundingSlack = 4e-6;

constexpr float kNearestDepthMax = 0x1.fffffep-1F;  // 1 - 2^-24

// Returns the largest float that is not above `depth`, clamped to [0, 1 - 2^-24].
float RoundTowardViewer(double depth) {
  const double inside = std::clamp(depth, 0.0, 1.0);
  auto rounded = static_cast<float>(inside);
  if (static_cast<double>(rounded) > inside) {
    rounded = std::nextafter(rounded, 0.0F);
  }
  return std::min(rounded, kNearestDepthMax);
}

math::Mat4d ProjectionMatrix(const Camera& camera, const Viewport& viewport, double near_distance,
                             double far_distance) {
  const double aspect =
      static_cast<double>(viewport.width_px) / static_cast<double>(viewport.height_px);
  const double depth = far_distance - near_distance;
  math::Mat4d clip_from_eye;
  if (camera.projection == Projection::kPerspective) {
    const double scale = 1 / math::Tan(camera.fov_y_radians / 2);
    clip_from_eye.At(0, 0) = scale / aspect;
    clip_from_eye.At(1, 1) = scale;
    clip_from_eye.At(2, 2) = -(far_distance + near_distance) / depth;
    clip_from_eye.At(2, 3) = -2 * far_distance * near_distance / depth;
    clip_from_eye.At(3, 2) = -1;
    clip_from_eye.At(3, 3) = 0;
  } else {
    clip_from_eye.At(0, 0) = 2 / (camera.view_height * aspect);
    clip_from_eye.At(1, 1) = 2 / camera.view_height;
    clip_from_eye.At(2, 2) = -2 / depth;
    clip_from_eye.At(2, 3) = -(far_distance + near_distance) / depth;
  }
  return clip_from_eye;
}

std::string OpeningOf(const Camera& camera) {
  return camera.projection == Projection::kPerspective
             ? absl::StrFormat("vertical angle %g radians", camera.fov_y_radians)
             : absl::StrFormat("view height %g", camera.view_height);
}

bool IsFinite(const math::Mat4d& matrix) {
  return std::all_of(matrix.m.begin(), matrix.m.end(), [](double x) { return std::isfinite(x); });
}

struct Range {
  double min = 0;
  double max = 0;
};

// Returns, for each clip coordinate, the sum of its products' sizes at the volume's farthest
// corner: the error of float32 is a part of it.
std::array<double, 4> ClipReach(const math::Mat4d& m, const math::Vec3d& last_sample) {
  std::array<double, 4> reach;
  for (std::size_t row = 0; row < 4; ++row) {
    reach[row] = std::abs(m.m[row]) * last_sample.x + std::abs(m.m[4 + row]) * last_sample.y +
                 std::abs(m.m[8 + row]) * last_sample.z + std::abs(m.m[12 + row]);
  }
  return reach;
}

// Returns the transform to eye space of index space, composed from origin - eye and not by
// multiplying matrices: a volume far from the world's origin keeps its digits.
math::Mat4d EyeFromIndex(const math::Mat3d& rotation, const Camera& camera,
                         const volume::GridGeometry& geometry) {
  math::Mat3d linear;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    linear.columns[axis] =
        rotation * (geometry.direction.columns[axis] * geometry.spacing[static_cast<int>(axis)]);
  }
  return math::MakeAffine(linear, rotation * (geometry.origin - camera.eye));
}

// Returns the distances, along the view direction, of the volume's nearest and farthest corners,
// moved apart by the slack.
Range DistancesOf(const math::Vec3d& last_sample, const math::Mat4d& eye_from_index) {
  Range distances{.min = std::numeric_limits<double>::infinity(),
                  .max = -std::numeric_limits<double>::infinity()};
  for (const math::Vec3d& corner : math::Box3d{{0, 0, 0}, last_sample}.Corners()) {
    const double distance = -math::TransformPoint(eye_from_index, corner).z;
    distances.min = std::min(distances.min, distance);
    distances.max = std::max(distances.max, distance);
  }
  const double slack =
      kPlaneSlack * (distances.max - distances.min) +
      kPlaneRoundingSlack * std::max(std::abs(distances.min), std::abs(distances.max));
  distances.min -= slack;
  distances.max += slack;
  return distances;
}

math::Vec3d ToDoubles(const math::Index3& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

math::Vec3d LastSampleOf(const volume::GridGeometry& geometry) {
  return ToDoubles(geometry.sample_dims - math::Index3{1, 1, 1});
}

ImagePlane MakeImagePlane(const View& view) {
  const Camera& camera = view.camera();
  const Viewport& viewport = view.viewport();
  ImagePlane plane;
  plane.is_perspective = camera.projection == Projection::kPerspective;
  plane.half_height =
      plane.is_perspective ? math::Tan(camera.fov_y_radians / 2) : camera.view_height / 2;
  plane.half_width = plane.half_height * viewport.width_px / viewport.height_px;
  plane.pixel_size = 2 * plane.half_height / viewport.height_px;
  plane.rays.origin.at = camera.eye;
  plane.rays.direction.at = view.forward();
  LinearVec3d& spread = plane.is_perspective ? plane.rays.direction : plane.rays.origin;
  const math::Vec3d corner =
      view.right() * (-plane.pixel_size * viewport.width_px / 2) + view.up() * plane.half_height;
  spread = {spread.at + corner, view.right() * plane.pixel_size, view.up() * -plane.pixel_size};
  return plane;
}

void SetBox(const math::Vec3d& min, const math::Vec3d& max, std::size_t i, FootprintBatch* batch) {
  for (int axis = 0; axis < 3; ++axis) {
    batch->min[static_cast<std::size_t>(axis)][i] = min[axis];
    batch->max[static_cast<std::size_t>(axis)][i] = max[axis];
  }
}

Footprint MakeFootprint(const FootprintBatch& batch, std::size_t i, const Region& region) {
  if (batch.outcome[i] == FootprintBatch::kOutside) {
    return {.rect = {}, .nearest_depth = kNearestDepthMax};
  }
  if (batch.outcome[i] == FootprintBatch::kWholePicture) {
    return {.rect = {0, 0, region.width_px, region.height_px}, .nearest_depth = 0};
  }
  const PixelRect rect{static_cast<int>(batch.begin_x[i]), static_cast<int>(batch.begin_y[i]),
                       static_cast<int>(batch.end_x[i]), static_cast<int>(batch.end_y[i])};
  return {.rect = rect.empty() ? PixelRect() : rect,
          .nearest_depth = RoundTowardViewer(batch.depth[i])};
}

}  // namespace

LinearVec3f ToFloats(const LinearVec3d& value) {
  const auto rounded = [](const math::Vec3d& v) {
    return std::array{static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
  };
  return {rounded(value.at), rounded(value.per_x), rounded(value.per_y)};
}

PixelRays PixelRays::TransformedBy(const math::Mat4d& m) const {
  return {{math::TransformPoint(m, origin.at), math::TransformVector(m, origin.per_x),
           math::TransformVector(m, origin.per_y)},
          {math::TransformVector(m, direction.at), math::TransformVector(m, direction.per_x),
           math::TransformVector(m, direction.per_y)}};
}

absl::StatusOr<View> View::Make(const Camera& camera, const Viewport& viewport,
                                const volume::GridGeometry& geometry,
                                const std::optional<Region>& region) {
  ISOSCOPE_RETURN_IF_ERROR(Validate(camera));
  ISOSCOPE_RETURN_IF_ERROR(Validate(viewport, region));
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(geometry));

  View view;
  view.camera_ = camera;
  view.viewport_ = viewport;
  view.region_ = region.value_or(Region{0, 0, viewport.width_px, viewport.height_px});
  const double target_distance = math::Length(camera.target - camera.eye);
  view.forward_ = math::Normalized(camera.target - camera.eye);
  view.right_ = math::Normalized(math::Cross(view.forward_, math::Normalized(camera.up)));
  view.up_ = math::Cross(view.right_, view.forward_);
  view.image_plane_ = MakeImagePlane(view);

  const Range distances =
      DistancesOf(LastSampleOf(geometry), EyeFromIndex(view.EyeRotation(), camera, geometry));
  const bool is_perspective = view.image_plane_.is_perspective;
  if (distances.max > 0) {
    view.far_distance_ = distances.max;
    view.near_distance_ =
        std::max(distances.min, is_perspective ? kMinNearFraction * distances.max : 0.0);
  } else {
    // The whole volume is behind the eye: any planes in front of the eye show the empty picture.
    view.far_distance_ = target_distance;
    view.near_distance_ = is_perspective ? kMinNearFraction * target_distance : 0.0;
  }

  ISOSCOPE_RETURN_IF_ERROR(view.SetGrid(geometry));
  return view;
}

absl::StatusOr<View> View::OnGrid(const volume::GridGeometry& grid) const {
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(grid));
  View view = *this;
  ISOSCOPE_RETURN_IF_ERROR(view.SetGrid(grid));
  return view;
}

// eye = rotation (world - eye position); x right, y up, z toward the viewer.
math::Mat3d View::EyeRotation() const { return math::Transposed({{right_, up_, -forward_}}); }

absl::Status View::SetGrid(const volume::GridGeometry& geometry) {
  geometry_ = geometry;
  world_from_index_ = geometry.world_from_index();
  index_from_world_ = geometry.index_from_world();
  const math::Mat3d rotation = EyeRotation();
  const math::Mat4d clip_from_eye =
      ProjectionMatrix(camera_, viewport_, near_distance_, far_distance_);
  clip_from_world_ = clip_from_eye * math::MakeAffine(rotation, -(rotation * camera_.eye));
  clip_from_index_ = clip_from_eye * EyeFromIndex(rotation, camera_, geometry);
  const std::array<double, 4> reach = ClipReach(clip_from_index_, LastSampleOf(geometry));
  const auto is_held = [](double x) { return x <= kMaxClipError / kClipError; };  // false for NaN
  if (!IsFinite(clip_from_world_) || !IsFinite(clip_from_index_) || !IsFinite(index_from_world_) ||
      !std::all_of(reach.begin(), reach.end(), is_held)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "camera eye %g, %g, %g, %s, with volume origin %g, %g, %g: the numbers are too large or "
        "too small for a projection; clip coordinates reach %g, and at most 2^120 (%g) are "
        "possible, because renderers compute them in 32-bit floats",
        camera_.eye.x, camera_.eye.y, camera_.eye.z, OpeningOf(camera_), geometry.origin.x,
        geometry.origin.y, geometry.origin.z, *std::max_element(reach.begin(), reach.end()),
        0x1p120));
  }
  return absl::OkStatus();
}

Footprint View::FootprintOf(const math::Vec3d& index_min, const math::Vec3d& index_max) const {
  FootprintBatch batch;
  batch.count = 1;
  for (std::size_t i = 0; i < FootprintBatch::kMultiple; ++i) {
    SetBox(index_min, index_max, i, &batch);
  }
  ComputeFootprints(clip_from_index_, viewport_, region_, &batch);
  return MakeFootprint(batch, 0, region_);
}

Footprint View::FootprintOf(const volume::BlockLayout& layout, volume::BlockId id) const {
  const math::IndexBox cells = layout.CellsOf(id);
  return FootprintOf(ToDoubles(cells.begin), ToDoubles(cells.end));
}

void View::FootprintsOf(const volume::BlockLayout& layout, absl::Span<const volume::BlockId> ids,
                        absl::Span<Footprint> footprints) const {
  ISOSCOPE_CHECK_EQ(ids.size(), footprints.size());
  FootprintBatch batch;
  for (std::size_t begin = 0; begin < ids.size(); begin += batch.count) {
    batch.count = std::min(FootprintBatch::kCapacity, ids.size() - begin);
    constexpr std::size_t kMultiple = FootprintBatch::kMultiple;
    const std::size_t filled = (batch.count + kMultiple - 1) / kMultiple * kMultiple;
    for (std::size_t i = 0; i < filled; ++i) {
      const math::IndexBox cells = layout.CellsOf(ids[begin + std::min(i, batch.count - 1)]);
      SetBox(ToDoubles(cells.begin), ToDoubles(cells.end), i, &batch);
    }
    ComputeFootprints(clip_from_index_, viewport_, region_, &batch);
    for (std::size_t i = 0; i < batch.count; ++i) {
      footprints[begin + i] = MakeFootprint(batch, i, region_);
    }
  }
}

}  // namespace isoscope::view
