// The camera of a request, from flags.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FLAGS_H_

#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/cli/flag_set.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/camera.h"

namespace isoscope::client {

// Either the first four or the last three; unset values are those of the default camera. The height
// is allowed with both, in place of the angle.
struct CameraFlags {
  std::optional<math::Vec3d> eye = std::nullopt;
  std::optional<math::Vec3d> target = std::nullopt;
  std::optional<math::Vec3d> up = std::nullopt;
  std::optional<double> fov_y_degrees = std::nullopt;

  std::optional<double> azimuth_degrees = std::nullopt;
  std::optional<double> elevation_degrees = std::nullopt;
  std::optional<double> zoom = std::nullopt;

  std::optional<double> orthographic_height = std::nullopt;  // world units; set: parallel
};

// `flags` must outlive the parsing.
void AddCameraFlags(cli::FlagSet* set, CameraFlags* flags);

// UsageError if flags of both kinds are given, or an angle and a height.
absl::Status CheckUsage(const CameraFlags& flags);

// Returns the camera for a volume with these bounds. As in VTK, azimuth comes first, then
// elevation, then `up` is made perpendicular to the view direction, then zoom. INVALID_ARGUMENT for
// an invalid camera: eye on target, or up along the view direction.
absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const math::Box3d& bounds);
// Does the same with `camera` in place of the default one of the bounds.
absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const view::Camera& start);

// Returns `camera` rotated by frame_index * orbit_degrees about its `up` through the target.
view::Camera OrbitCamera(const view::Camera& camera, double orbit_degrees, int frame_index);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FLAGS_H_
