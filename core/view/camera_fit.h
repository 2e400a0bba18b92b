// Cameras that fit an object: the volume from a named side, or the surface instead of the volume.

#ifndef ISOSCOPE_CORE_VIEW_CAMERA_FIT_H_
#define ISOSCOPE_CORE_VIEW_CAMERA_FIT_H_

#include <optional>
#include <span>

#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/view/camera.h"
#include "core/view/clip_region.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"

namespace isoscope::view {

// Returns the world box around the cells [begin, end) of a grid. REQUIRES: they are cells of it.
math::Box3d BoundsOfCells(const volume::GridGeometry& geometry, const math::IndexBox& cells);

// Returns the part of `bounds` inside the region's box; `bounds` if there is no box, or if only a
// point would be left.
math::Box3d ClippedBounds(const math::Box3d& bounds, const ClipRegion& clip);

// Returns a camera for box `to` that frames it as `camera` frames box `from`: moved and scaled as
// the sphere around one box to the sphere around the other. Direction, up and angle stay the same.
// REQUIRES: from.Radius() > 0.
Camera MoveToBox(const Camera& camera, const math::Box3d& from, const math::Box3d& to);

// The share of the picture that a box takes at most where a camera frames it tightly.
inline constexpr double kTightShare = 0.95;

// Returns a camera for box `to` as MoveToBox does, but tight: if `camera` has the distance of the
// default camera of `from`, or its height, the whole box `to` is in the picture of this size, and takes
// kTightShare of its width or of its height. Other distances and heights are scaled in proportion.
// The camera is invalid if `to` is a point. REQUIRES: from.Radius() > 0, the camera is valid.
Camera FitToBox(const Camera& camera, const Viewport& viewport, const math::Box3d& from,
                const math::Box3d& to);

// The sides to look from; named_views.inc has their numbers. Front is the default camera's.
//
//   side     eye at   up          side of the patient   eye at       up
//   front    +z       +y          anterior              anterior     superior
//   back     -z       +y          posterior             posterior    superior
//   right    +x       +y          left                  left         superior
//   left     -x       +y          right                 right        superior
//   top      +y       -z          superior              superior     anterior
//   bottom   -y       +z          inferior              inferior     anterior
enum class NamedView {
  kFront,
  kBack,
  kLeft,   // the patient's left, where a patient frame is known
  kRight,  // the patient's right, where a patient frame is known
  kTop,
  kBottom,
  kAnterior,
  kPosterior,
  kSuperior,
  kInferior,
};

// The direction from the target to the eye, and the up direction: unit vectors.
struct Side {
  math::Vec3d to_eye;
  math::Vec3d up;
};

// A row of named_views.inc.
struct NamedViewRow {
  const char* name;  // as people write it: "front"
  NamedView named_view;
  Side world;             // 0: none
  char patient_sides[3];  // PatientSide of the eye and of up; "": none

  [[nodiscard]] bool has_world() const { return !(world.up == math::Vec3d{0, 0, 0}); }
  [[nodiscard]] bool has_patient() const { return patient_sides[0] != '\0'; }
};

// All views. The six that have a side of the world, and the six that have one of a patient, are in
// the order of the keys 1 to 6.
std::span<const NamedViewRow> NamedViewTable();

// Returns the default camera of `bounds` (MakeDefaultCamera) from another side. INVALID_ARGUMENT if
// the view is one of a patient, and there is no patient frame.
absl::StatusOr<Camera> MakeNamedCamera(NamedView named_view, const math::Box3d& bounds,
                                       const std::optional<volume::PatientFrame>& patient_frame);

// Returns the camera of a first look at `bounds`: of patients from anterior; else the default camera,
// turned by azimuth and then elevation (Azimuth, Elevation), with `up` perpendicular to its direction.
Camera MakeFirstLookCamera(double azimuth_radians, double elevation_radians,
                           const math::Box3d& bounds,
                           const std::optional<volume::PatientFrame>& patient_frame);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_CAMERA_FIT_H_
