// Makes a view in four steps:
//
//   1. The camera's unit vectors right, up and -forward are the rows of the rotation to eye space.
//   2. eye_from_index is composed directly, not as eye_from_world * world_from_index.
//   3. The clip planes fit the 8 corners of the volume, plus a slack; near is at least 1/1000 of
//      far for perspective, at least 0 for orthographic.
//   4. Projection times both eye matrices gives clip_from_world and clip_from_index.
//
// A footprint answers, for a box of cells: which pixels can a float32 renderer cover, and how near
// can a fragment be? It projects the 8 corners in double and grows their rectangle by a bound of
// the renderer's error. Three cases need care: a box outside one plane of the frustum has no
// pixels; a box that reaches the near plane, or has w <= 0, or needs a margin above 4 pixels, or
// leaves float32's range, gets the whole picture and depth 0, so it is never hidden; any other gets
// its rectangle and the depth of its nearest corner, rounded towards the viewer.
//
// A region only cuts rectangles, and counts their pixels from its own corner. All else is the
// whole's, so that a region has the whole's pixels.
//
// Invariant: the same operations in the same order on every agent, in double, without contraction.
// footprint_kernel.cc does the same for many boxes at a time; its example has numbers.
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
// The planes keep off the volume, so that nothing on its boundary is clipped: by this fraction of
// its depth, plus this fraction of its distance for the error of float32 clip coordinates
// (kClipError, with room to spare).
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

// A box in clip space: its corners, coordinate by coordinate, and the bound of the float32 error of
// each coordinate. Plain loops over the corners, which compilers turn into SIMD.
struct ClipBox {
  static constexpr std::size_t kCorners = 8;
  std::array<std::array<double, kCorners>, 4> corners;  // [x, y, z, w][corner]
  std::array<double, 4> error;
};

ClipBox ProjectBox(const math::Mat4d& m, const math::Vec3d& min, const math::Vec3d& max) {
  ClipBox box;
  const double reach_x = std::max(std::abs(min.x), std::abs(max.x));
  const double reach_y = std::max(std::abs(min.y), std::abs(max.y));
  const double reach_z = std::max(std::abs(min.z), std::abs(max.z));
  for (std::size_t row = 0; row < 4; ++row) {
    const double mx = m.m[row];
    const double my = m.m[4 + row];
    const double mz = m.m[8 + row];
    const double mw = m.m[12 + row];
    for (std::size_t corner = 0; corner < ClipBox::kCorners; ++corner) {
      const double x = (corner & 1) != 0 ? max.x : min.x;
      const double y = (corner & 2) != 0 ? max.y : min.y;
      const double z = (corner & 4) != 0 ? max.z : min.z;
      box.corners[row][corner] = mx * x + my * y + (mz * z + mw);
    }
    box.error[row] = kClipError * (std::abs(mx) * reach_x + std::abs(my) * reach_y +
                                   std::abs(mz) * reach_z + std::abs(mw));
  }
  return box;
}

// Whether float32 holds all coordinates, in whatever order they are summed. False for NaN; so if it
// is true, no coordinate and no sum of two is NaN or infinite.
bool IsWithinFloat(const ClipBox& box) {
  return std::all_of(box.error.begin(), box.error.end(),
                     [](double error) { return error <= kMaxClipError; });
}

struct Range {
  double min = 0;
  double max = 0;
};

// Returns the range of value(corner) over all corners.
template <typename Value>
Range RangeOf(const Value& value) {
  Range range{value(0), value(0)};
  for (std::size_t corner = 1; corner < ClipBox::kCorners; ++corner) {
    const double v = value(corner);
    range.min = v < range.min ? v : range.min;
    range.max = v > range.max ? v : range.max;
  }
  return range;
}

// Returns true if the whole box is outside one plane of the frustum by more than the error. The
// planes are linear, so the corners decide, whatever the sign of w.
bool IsOutside(const ClipBox& box) {
  const std::array<double, ClipBox::kCorners>& w = box.corners[3];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::array<double, ClipBox::kCorners>& c = box.corners[axis];
    const double error = box.error[axis] + box.error[3];
    if (RangeOf([&](std::size_t i) { return c[i] + w[i]; }).max < -error ||
        RangeOf([&](std::size_t i) { return c[i] - w[i]; }).min > error) {
      return true;
    }
  }
  return false;
}

// Finds the pixels [begin, end) of an axis whose centres lie in [min - margin, max + margin], in
// the window of `size_px` pixels from `window_px` on, counted from there.
void CoverPixels(double min, double max, double margin, int window_px, int size_px, int* begin,
                 int* end) {
  const double first = std::ceil(min - margin - 0.5) - window_px;
  const double last = std::floor(max + margin - 0.5) - window_px;
  *begin = static_cast<int>(std::clamp(first, 0.0, static_cast<double>(size_px)));
  *end = static_cast<int>(std::clamp(last + 1, 0.0, static_cast<double>(size_px)));
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
Range DistancesOf(const volume::GridGeometry& geometry, const math::Mat4d& eye_from_index) {
  math::Box3d index_box;
  index_box.Add({0, 0, 0});
  index_box.Add({static_cast<double>(geometry.sample_dims.x - 1),
                 static_cast<double>(geometry.sample_dims.y - 1),
                 static_cast<double>(geometry.sample_dims.z - 1)});
  Range distances{.min = std::numeric_limits<double>::infinity(),
                  .max = -std::numeric_limits<double>::infinity()};
  for (const math::Vec3d& corner : index_box.Corners()) {
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

}  // namespace

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
  view.geometry_ = geometry;
  view.world_from_index_ = geometry.world_from_index();
  view.index_from_world_ = geometry.index_from_world();
  const double target_distance = math::Length(camera.target - camera.eye);
  view.forward_ = math::Normalized(camera.target - camera.eye);
  view.right_ = math::Normalized(math::Cross(view.forward_, math::Normalized(camera.up)));
  view.up_ = math::Cross(view.right_, view.forward_);

  // eye = rotation (world - eye position); x right, y up, z toward the viewer.
  const math::Mat3d rotation = math::Transposed({{view.right_, view.up_, -view.forward_}});
  const math::Mat4d eye_from_world = math::MakeAffine(rotation, -(rotation * camera.eye));
  const math::Mat4d eye_from_index = EyeFromIndex(rotation, camera, geometry);

  const Range distances = DistancesOf(geometry, eye_from_index);
  const bool is_perspective = camera.projection == Projection::kPerspective;
  if (distances.max > 0) {
    view.far_distance_ = distances.max;
    view.near_distance_ =
        std::max(distances.min, is_perspective ? kMinNearFraction * distances.max : 0.0);
  } else {
    // The whole volume is behind the eye: any planes in front of the eye show the empty picture.
    view.far_distance_ = target_distance;
    view.near_distance_ = is_perspective ? kMinNearFraction * target_distance : 0.0;
  }

  const math::Mat4d clip_from_eye =
      ProjectionMatrix(camera, viewport, view.near_distance_, view.far_distance_);
  view.clip_from_world_ = clip_from_eye * eye_from_world;
  view.clip_from_index_ = clip_from_eye * eye_from_index;
  const math::Index3& dims = geometry.sample_dims;
  const ClipBox volume =
      ProjectBox(view.clip_from_index_, {0, 0, 0},
                 {static_cast<double>(dims.x - 1), static_cast<double>(dims.y - 1),
                  static_cast<double>(dims.z - 1)});
  if (!IsFinite(view.clip_from_world_) || !IsFinite(view.clip_from_index_) ||
      !IsFinite(view.index_from_world_) || !IsWithinFloat(volume)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "camera eye %g, %g, %g, %s, with volume origin %g, %g, %g: the numbers are too large or "
        "too small for a projection; clip coordinates reach %g, and at most 2^120 (%g) are "
        "possible, because renderers compute them in 32-bit floats",
        camera.eye.x, camera.eye.y, camera.eye.z, OpeningOf(camera), geometry.origin.x,
        geometry.origin.y, geometry.origin.z,
        *std::max_element(volume.error.begin(), volume.error.end()) / kClipError, 0x1p120));
  }
  return view;
}

Footprint View::FootprintOf(const math::Vec3d& index_min, const math::Vec3d& index_max) const {
  const Footprint everything{.rect = {0, 0, region_.width_px, region_.height_px},
                             .nearest_depth = 0};
  const ClipBox box = ProjectBox(clip_from_index_, index_min, index_max);
  if (!IsWithinFloat(box)) {
    return everything;
  }
  if (IsOutside(box)) {
    return {.rect = {}, .nearest_depth = kNearestDepthMax};
  }
  const std::array<double, ClipBox::kCorners>& clip_x = box.corners[0];
  const std::array<double, ClipBox::kCorners>& clip_y = box.corners[1];
  const std::array<double, ClipBox::kCorners>& clip_z = box.corners[2];
  const std::array<double, ClipBox::kCorners>& clip_w = box.corners[3];
  const auto& [error_x, error_y, error_z, error_w] = box.error;
  if (RangeOf([&](std::size_t i) { return clip_z[i] + clip_w[i]; }).min < error_z + error_w) {
    return everything;  // reaches the near plane, where a renderer clips
  }
  const double min_w = RangeOf([&](std::size_t i) { return clip_w[i]; }).min - error_w;
  if (!(min_w >= kMinClipW)) {
    return everything;
  }

  std::array<double, ClipBox::kCorners> inverse_w;
  for (std::size_t i = 0; i < ClipBox::kCorners; ++i) {
    inverse_w[i] = 1 / clip_w[i];
  }
  const Range x = RangeOf([&](std::size_t i) { return clip_x[i] * inverse_w[i]; });
  const Range y = RangeOf([&](std::size_t i) { return clip_y[i] * inverse_w[i]; });
  const Range z = RangeOf([&](std::size_t i) { return clip_z[i] * inverse_w[i]; });
  const double half_width = 0.5 * viewport_.width_px;
  const double half_height = 0.5 * viewport_.height_px;
  const double reach_x = std::max(std::abs(x.min), std::abs(x.max));
  const double reach_y = std::max(std::abs(y.min), std::abs(y.max));
  const double margin_x =
      half_width * ((error_x + reach_x * error_w) / min_w + kViewportError * (reach_x + 1)) +
      kSnapErrorPx;
  const double margin_y =
      half_height * ((error_y + reach_y * error_w) / min_w + kViewportError * (reach_y + 1)) +
      kSnapErrorPx;
  if (!(margin_x <= kMaxMarginPx && margin_y <= kMaxMarginPx)) {
    return everything;
  }

  Footprint footprint;
  CoverPixels(half_width * (x.min + 1), half_width * (x.max + 1), margin_x, region_.x,
              region_.width_px, &footprint.rect.begin_x, &footprint.rect.end_x);
  CoverPixels(half_height * (1 - y.max), half_height * (1 - y.min), margin_y, region_.y,
              region_.height_px, &footprint.rect.begin_y, &footprint.rect.end_y);
  if (footprint.rect.empty()) {
    footprint.rect = {};
  }
  footprint.nearest_depth = RoundTowardViewer(0.5 * z.min + 0.5);
  return footprint;
}

Footprint View::FootprintOf(const volume::BlockLayout& layout, volume::BlockId id) const {
  const math::IndexBox cells = layout.CellsOf(id);
  return FootprintOf({static_cast<double>(cells.begin.x), static_cast<double>(cells.begin.y),
                      static_cast<double>(cells.begin.z)},
                     {static_cast<double>(cells.end.x), static_cast<double>(cells.end.y),
                      static_cast<double>(cells.end.z)});
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
      for (int axis = 0; axis < 3; ++axis) {
        batch.min[static_cast<std::size_t>(axis)][i] = static_cast<double>(cells.begin[axis]);
        batch.max[static_cast<std::size_t>(axis)][i] = static_cast<double>(cells.end[axis]);
      }
    }
    ComputeFootprints(clip_from_index_, viewport_, region_, &batch);
    for (std::size_t i = 0; i < batch.count; ++i) {
      Footprint& footprint = footprints[begin + i];
      switch (batch.outcome[i]) {
        case FootprintBatch::kOnScreen:
          footprint.rect = {static_cast<int>(batch.begin_x[i]), static_cast<int>(batch.begin_y[i]),
                            static_cast<int>(batch.end_x[i]), static_cast<int>(batch.end_y[i])};
          if (footprint.rect.empty()) {
            footprint.rect = {};
          }
          footprint.nearest_depth = RoundTowardViewer(batch.depth[i]);
          break;
        case FootprintBatch::kOutside:
          footprint = {.rect = {}, .nearest_depth = kNearestDepthMax};
          break;
        case FootprintBatch::kUndecided:
          footprint = FootprintOf(layout, ids[begin + i]);
          break;
      }
    }
  }
}

}  // namespace isoscope::view
