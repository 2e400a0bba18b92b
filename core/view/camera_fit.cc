#include "core/view/camera_fit.h"

#include <algorithm>
#include <iterator>

#include "absl/status/status.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
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

}  // namespace isoscope::view
