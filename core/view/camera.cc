// Cameras are described as in VTK: eye, target, up, and a vertical angle or a height. Validate
// rejects those that have no matrix, with the numbers in the message. Azimuth and Elevation turn
// the eye around the target; up stays, and OrthogonalizeUp makes it perpendicular again.
//
// MakeDefaultCamera looks along -z at a sphere around the bounds: with a vertical angle of 30
// degrees the eye is at radius / sin(15 degrees).

#include "core/view/camera.h"

#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/math/elementary.h"

namespace isoscope::view {
namespace {

// The sine of the smallest angle between `up` and the view direction at which `up` counts as a
// direction of its own: far above rounding errors, far below the angles of real cameras.
constexpr double kMinUpSine = 1e-6;

// Rotates `v` about the unit vector `axis`, right-handed. Source: Rodrigues' rotation formula.
math::Vec3d Rotated(const math::Vec3d& v, const math::Vec3d& axis, double radians) {
  const double c = math::Cos(radians);
  const double s = math::Sin(radians);
  return v * c + math::Cross(axis, v) * s + axis * (math::Dot(axis, v) * (1 - c));
}

absl::Status ValidateVector(const char* name, const math::Vec3d& v) {
  if (!math::IsFinite(v)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("camera %s %g, %g, %g: each must be a finite number", name, v.x, v.y, v.z));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status Validate(const Camera& camera) {
  for (const absl::Status& status :
       {ValidateVector("eye", camera.eye), ValidateVector("target", camera.target),
        ValidateVector("up", camera.up)}) {
    if (!status.ok()) {
      return status;
    }
  }
  const math::Vec3d direction = camera.target - camera.eye;
  const double distance = math::Length(direction);
  if (!(distance > 0)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("camera eye and target are both %g, %g, %g: they must differ", camera.eye.x,
                        camera.eye.y, camera.eye.z));
  }
  if (!std::isfinite(distance)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "camera eye %g, %g, %g and target %g, %g, %g: too far apart for their distance to be a "
        "number",
        camera.eye.x, camera.eye.y, camera.eye.z, camera.target.x, camera.target.y,
        camera.target.z));
  }
  const double up_length = math::Length(camera.up);
  if (!(up_length > 0) || !std::isfinite(up_length)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("camera up %g, %g, %g has length %g: it must be finite and greater than 0",
                        camera.up.x, camera.up.y, camera.up.z, up_length));
  }
  const double sine =
      math::Length(math::Cross(direction * (1 / distance), camera.up * (1 / up_length)));
  if (!(sine >= kMinUpSine)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "camera up %g, %g, %g is parallel to the view direction %g, %g, %g: choose another up",
        camera.up.x, camera.up.y, camera.up.z, direction.x, direction.y, direction.z));
  }
  if (camera.projection == Projection::kPerspective) {
    if (!(camera.fov_y_radians > 0 && camera.fov_y_radians < std::numbers::pi)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "camera vertical angle %g radians: it must be greater than 0 and less than pi",
          camera.fov_y_radians));
    }
  } else if (!(camera.view_height > 0) || !std::isfinite(camera.view_height)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "camera view height %g: it must be finite and greater than 0", camera.view_height));
  }
  return absl::OkStatus();
}

absl::Status Validate(const Viewport& viewport) {
  for (const int side : {viewport.width_px, viewport.height_px}) {
    if (side < 1 || side > kMaxViewportPx) {
      return absl::InvalidArgumentError(
          absl::StrFormat("viewport of %d x %d pixels: each side must be 1 to %d",
                          viewport.width_px, viewport.height_px, kMaxViewportPx));
    }
  }
  return absl::OkStatus();
}

absl::Status Validate(const Viewport& viewport, const std::optional<Region>& region) {
  if (!region.has_value()) {
    return Validate(viewport);
  }
  for (const int side : {viewport.width_px, viewport.height_px}) {
    if (side < 1 || side > kMaxWholeViewportPx) {
      return absl::InvalidArgumentError(
          absl::StrFormat("viewport of %d x %d pixels with a region: each side must be 1 to %d",
                          viewport.width_px, viewport.height_px, kMaxWholeViewportPx));
    }
  }
  const auto is_inside = [](int begin, int size, int whole) {
    return begin >= 0 && begin < whole && size >= 1 && size <= kMaxViewportPx &&
           size <= whole - begin;
  };
  if (!is_inside(region->x, region->width_px, viewport.width_px) ||
      !is_inside(region->y, region->height_px, viewport.height_px)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("region of %d x %d pixels at %d, %d: each side must be 1 to %d, and inside "
                        "the viewport of %d x %d pixels",
                        region->width_px, region->height_px, region->x, region->y, kMaxViewportPx,
                        viewport.width_px, viewport.height_px));
  }
  return absl::OkStatus();
}

Camera MakeDefaultCamera(const math::Box3d& bounds) {
  Camera camera;
  camera.fov_y_radians = std::numbers::pi / 6;
  camera.target = bounds.Center();
  // VTK's radius for a box without a size.
  const double radius = bounds.Radius() > 0 ? bounds.Radius() : 0.5;
  const double distance = radius / math::Sin(camera.fov_y_radians / 2);
  camera.eye = camera.target + math::Vec3d{0, 0, distance};
  camera.up = {0, 1, 0};
  camera.view_height = 2 * radius;
  return camera;
}

void Azimuth(double radians, Camera* camera) {
  const math::Vec3d axis = math::Normalized(camera->up);
  camera->eye = camera->target + Rotated(camera->eye - camera->target, axis, radians);
}

void Elevation(double radians, Camera* camera) {
  const math::Vec3d right = math::Normalized(math::Cross(camera->target - camera->eye, camera->up));
  camera->eye = camera->target + Rotated(camera->eye - camera->target, -right, radians);
}

void OrthogonalizeUp(Camera* camera) {
  const math::Vec3d forward = math::Normalized(camera->target - camera->eye);
  const math::Vec3d right = math::Normalized(math::Cross(forward, camera->up));
  camera->up = math::Cross(right, forward);
}

void Zoom(double factor, Camera* camera) {
  ISOSCOPE_CHECK_GT(factor, 0.0);
  if (camera->projection == Projection::kPerspective) {
    camera->fov_y_radians /= factor;
  } else {
    camera->view_height /= factor;
  }
}

}  // namespace isoscope::view
