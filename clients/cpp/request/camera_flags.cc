#include "clients/cpp/request/camera_flags.h"

#include <numbers>
#include <string>

#include "absl/strings/str_cat.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"

namespace isoscope::client {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;

absl::StatusOr<double> ParseFieldOfView(absl::string_view text) {
  absl::StatusOr<double> degrees = ParseNumber(text);
  if (!degrees.ok() || *degrees <= 0 || *degrees >= 180) {
    return absl::InvalidArgumentError(absl::StrCat(
        base::Quoted(text, '\''), " is not an angle in degrees, above 0 and below 180"));
  }
  return degrees;
}

}  // namespace

void AddCameraFlags(cli::FlagSet* set, CameraFlags* flags) {
  const std::string group = "Camera (default: the first look, as of the page)";
  const auto add = [&](cli::Flag flag) { flag.Group(group); };
  add(cli::AddFlag(set, "--eye", "X,Y,Z", &flags->eye, ParseVector,
                   "position of the eye, world space"));
  add(cli::AddFlag(set, "--target", "X,Y,Z", &flags->target, ParseVector,
                   "what it looks at (default: the volume's centre)"));
  add(cli::AddFlag(set, "--up", "X,Y,Z", &flags->up, ParseVector, "what is up (default: 0,1,0)"));
  add(cli::AddFlag(set, "--fov-y", "DEG", &flags->fov_y_degrees, ParseFieldOfView,
                   "vertical angle of view (default: 30)"));
  add(cli::AddFlag(set, "--orthographic-height", "H", &flags->orthographic_height,
                   ParsePositiveNumber,
                   "parallel projection: the picture is H high, in world units; not with --fov-y"));
  add(cli::AddFlag(set, "--azimuth", "DEG", &flags->azimuth_degrees, ParseNumber,
                   "turn the default camera about up; not with --eye, --target, --up, --fov-y"));
  add(cli::AddFlag(set, "--elevation", "DEG", &flags->elevation_degrees, ParseNumber,
                   "then about its right axis"));
  add(cli::AddFlag(set, "--zoom", "F", &flags->zoom, ParsePositiveNumber,
                   "divide the angle of view by F"));
}

absl::Status CheckUsage(const CameraFlags& flags) {
  const char* placed = flags.eye             ? "--eye"
                       : flags.target        ? "--target"
                       : flags.up            ? "--up"
                       : flags.fov_y_degrees ? "--fov-y"
                                             : nullptr;
  const char* turned = flags.azimuth_degrees     ? "--azimuth"
                       : flags.elevation_degrees ? "--elevation"
                       : flags.zoom              ? "--zoom"
                                                 : nullptr;
  if (flags.orthographic_height && flags.fov_y_degrees) {
    return cli::UsageError(
        "--orthographic-height can't be used with --fov-y: a parallel projection has no angle");
  }
  if (placed != nullptr && turned != nullptr) {
    return cli::UsageError(absl::StrCat(placed, " can't be used with ", turned,
                                        ": give --eye, --target, --up, --fov-y, or --azimuth, "
                                        "--elevation, --zoom"));
  }
  return absl::OkStatus();
}

absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const math::Box3d& bounds) {
  return ResolveCamera(flags, view::MakeDefaultCamera(bounds));
}

absl::StatusOr<view::Camera> ResolveCamera(const CameraFlags& flags, const view::Camera& start) {
  view::Camera camera = start;
  camera.eye = flags.eye.value_or(camera.eye);
  camera.target = flags.target.value_or(camera.target);
  camera.up = flags.up.value_or(camera.up);
  if (flags.fov_y_degrees) {
    camera.fov_y_radians = *flags.fov_y_degrees * kRadiansPerDegree;
  }
  if (flags.orthographic_height) {
    camera.projection = view::Projection::kOrthographic;
    camera.view_height = *flags.orthographic_height;
  }
  // Checked first, because the rest divides by the checked values.
  ISOSCOPE_RETURN_IF_ERROR(view::Validate(camera));
  if (flags.azimuth_degrees) {
    view::Azimuth(*flags.azimuth_degrees * kRadiansPerDegree, &camera);
  }
  if (flags.elevation_degrees) {
    view::Elevation(*flags.elevation_degrees * kRadiansPerDegree, &camera);
    ISOSCOPE_RETURN_IF_ERROR(view::Validate(camera));
    view::OrthogonalizeUp(&camera);
  }
  if (flags.zoom) {
    view::Zoom(*flags.zoom, &camera);
  }
  ISOSCOPE_RETURN_IF_ERROR(view::Validate(camera));
  return camera;
}

view::Camera OrbitCamera(const view::Camera& camera, double orbit_degrees, int frame_index) {
  view::Camera turned = camera;
  if (frame_index > 0 && orbit_degrees != 0) {
    view::Azimuth(frame_index * orbit_degrees * kRadiansPerDegree, &turned);
  }
  return turned;
}

}  // namespace isoscope::client
