#include "core/view/camera_fit.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "absl/status/status.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/math/elementary.h"
#include "core/math/matrix.h"

namespace isoscope::view {
namespace {

using volume::PatientFrame;
using volume::PatientSide;

constexpr NamedViewRow kNamedViews[] = {
#include "core/view/named_views.inc"
};

absl::StatusOr<Side> SideOf(NamedView named_view, const std::optional<PatientFrame>& patient) {
  const auto* row = std::find_if(
      std::begin(kNamedViews), std::end(kNamedViews),
      [&](const NamedViewRow& candidate) { return candidate.named_view == named_view; });
  ISOSCOPE_CHECK(row != std::end(kNamedViews));
  if (patient && row->has_patient()) {
    return Side{patient->DirectionTo(PatientSide{row->patient_sides[0]}),
                patient->DirectionTo(PatientSide{row->patient_sides[1]})};
  }
  if (!row->has_world()) {
    return absl::InvalidArgumentError(
        "a view of a patient, but the source of the dataset has no patient frame (NIfTI with a "
        "qform or sform, DICOM, and NRRD with the space LPS or RAS have one; datasets made "
        "before it was kept must be partitioned anew): use front, back, left, right, top or "
        "bottom");
  }
  return row->world;
}

}  // namespace

math::Box3d BoundsOfCells(const volume::GridGeometry& geometry, const math::IndexBox& cells) {
  math::Box3d index_box;
  for (const math::Index3& corner : {cells.begin, cells.end}) {
    index_box.Add({static_cast<double>(corner.x), static_cast<double>(corner.y),
                   static_cast<double>(corner.z)});
  }
  const math::Mat4d to_world = geometry.world_from_index();
  math::Box3d bounds;
  for (const math::Vec3d& corner : index_box.Corners()) {
    bounds.Add(math::TransformPoint(to_world, corner));
  }
  return bounds;
}

math::Box3d ClippedBounds(const math::Box3d& bounds, const ClipRegion& clip) {
  if (!clip.box) {
    return bounds;
  }
  math::Box3d clipped;
  for (int axis = 0; axis < 3; ++axis) {
    clipped.min[axis] = std::max(bounds.min[axis], clip.box->min[axis]);
    clipped.max[axis] = std::min(bounds.max[axis], clip.box->max[axis]);
    if (clipped.min[axis] > clipped.max[axis]) {
      return bounds;
    }
  }
  return clipped.Radius() > 0 ? clipped : bounds;
}

Camera MoveToBox(const Camera& camera, const math::Box3d& from, const math::Box3d& to) {
  ISOSCOPE_CHECK_GT(from.Radius(), 0.0);
  const double scale = to.Radius() / from.Radius();
  Camera moved = camera;
  moved.eye = to.Center() + (camera.eye - from.Center()) * scale;
  moved.target = to.Center() + (camera.target - from.Center()) * scale;
  moved.view_height = camera.view_height * scale;
  return moved;
}

Camera FitToBox(const Camera& camera, const Viewport& viewport, const math::Box3d& from,
                const math::Box3d& to) {
  ISOSCOPE_CHECK_GT(from.Radius(), 0.0);
  const math::Vec3d to_eye = math::Normalized(camera.eye - camera.target);
  const math::Vec3d right = math::Normalized(math::Cross(camera.up, to_eye));
  const math::Vec3d up = math::Cross(to_eye, right);
  const double aspect =
      static_cast<double>(viewport.width_px) / static_cast<double>(viewport.height_px);
  // By which the picture's half height and half width grow with the distance; parallel: both are 1
  // and `aspect` for a height of 2.
  const bool is_parallel = camera.projection == Projection::kOrthographic;
  const double slope = kTightShare * (is_parallel ? 1 : math::Tan(camera.fov_y_radians / 2));
  double least = 0;  // distance of the eye from the middle of the box; parallel: half height
  for (const math::Vec3d& corner : to.Corners()) {
    const math::Vec3d offset = corner - to.Center();
    const double extent = std::max(std::abs(math::Dot(offset, right)) / (slope * aspect),
                                   std::abs(math::Dot(offset, up)) / slope);
    least = std::max(least, extent + (is_parallel ? 0 : math::Dot(offset, to_eye)));
  }
  const double standard =
      is_parallel ? from.Radius() : from.Radius() / math::Sin(camera.fov_y_radians / 2);
  const double scale = least / standard;
  Camera fitted = camera;
  fitted.target = to.Center() + (camera.target - from.Center()) * scale;
  // A parallel picture does not depend on the distance: it stays outside of the box.
  const double distance_scale = is_parallel ? to.Radius() / from.Radius() : scale;
  fitted.eye = fitted.target + (camera.eye - camera.target) * distance_scale;
  fitted.view_height = camera.view_height * scale;
  return fitted;
}

std::span<const NamedViewRow> NamedViewTable() { return kNamedViews; }

absl::StatusOr<Camera> MakeNamedCamera(NamedView named_view, const math::Box3d& bounds,
                                       const std::optional<PatientFrame>& patient_frame) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Side side, SideOf(named_view, patient_frame));
  Camera camera = MakeDefaultCamera(bounds);
  const double distance = camera.eye.z - camera.target.z;
  camera.eye = camera.target + side.to_eye * distance;
  camera.up = side.up;
  return camera;
}

Camera MakeFirstLookCamera(double azimuth_radians, double elevation_radians,
                           const math::Box3d& bounds,
                           const std::optional<PatientFrame>& patient_frame) {
  if (patient_frame) {
    absl::StatusOr<Camera> anterior = MakeNamedCamera(NamedView::kAnterior, bounds, patient_frame);
    ISOSCOPE_CHECK(anterior.ok());
    return *std::move(anterior);
  }
  Camera camera = MakeDefaultCamera(bounds);
  Azimuth(azimuth_radians, &camera);
  Elevation(elevation_radians, &camera);
  OrthogonalizeUp(&camera);
  return camera;
}

}  // namespace isoscope::view
