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

// Either the first four or the last three; what is not given is as in the default camera. The
// height goes with both, in place of the angle.
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

// The camera for a volume with these bounds. As in VTK, azimuth comes first, then elevation, then
// `up` is made perpendicular to the view direction, then zoom.
// INVALID_ARGUMENT if it can't see: eye on target, up along the view direction.
absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const math::Box3d& bounds);
// The same from another camera than the default one of the bounds.
absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const view::Camera& start);

// `camera` turned by frame_index * orbit_degrees about its `up` through the target.
view::Camera OrbitCamera(const view::Camera& camera, double orbit_degrees, int frame_index);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FLAGS_H_
