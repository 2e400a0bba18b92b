// Cameras, with VTK's conventions (docs/numerics.md, "Camera"). Eye, target and up are in world
// space. All functions are thread-safe.

#ifndef ISOSCOPE_CORE_VIEW_CAMERA_H_
#define ISOSCOPE_CORE_VIEW_CAMERA_H_

#include <optional>

#include "absl/status/status.h"

#include "core/math/box.h"
#include "core/math/vec.h"

namespace isoscope::view {

enum class Projection { kPerspective, kOrthographic };

struct Camera {
  math::Vec3d eye;
  math::Vec3d target;
  math::Vec3d up{0, 1, 0};
  Projection projection = Projection::kPerspective;
  double fov_y_radians = 0;  // perspective: full vertical angle, in (0, pi)
  double view_height = 0;    // orthographic: world height of the image, > 0

  friend bool operator==(const Camera&, const Camera&) = default;
};

struct Viewport {
  int width_px = 0;
  int height_px = 0;

  friend bool operator==(const Viewport&, const Viewport&) = default;
};

// A window of a viewport, in pixels of the whole; row 0 is the top.
struct Region {
  int x = 0;
  int y = 0;
  int width_px = 0;
  int height_px = 0;

  friend bool operator==(const Region&, const Region&) = default;
};

// The largest side of a picture, which is a viewport or a region of one.
inline constexpr int kMaxViewportPx = 16384;
// The largest side of a viewport of which only a region is asked for.
inline constexpr int kMaxWholeViewportPx = 65536;
// The default of clients; servers keep images of this size ready.
inline constexpr Viewport kCommonViewport{.width_px = 1024, .height_px = 1024};

// Returns INVALID_ARGUMENT, with the field and its value, unless the camera is valid: all
// components are finite, eye != target, up is not parallel to the view direction, and the angle or
// height is in its range.
absl::Status Validate(const Camera& camera);
// Returns INVALID_ARGUMENT unless both sides are in [1, kMaxViewportPx].
absl::Status Validate(const Viewport& viewport);
// With a region, both sides of the viewport may be up to kMaxWholeViewportPx. INVALID_ARGUMENT if
// the region is empty, larger than kMaxViewportPx, or not inside the viewport.
absl::Status Validate(const Viewport& viewport, const std::optional<Region>& region);

// Returns the size of the picture: the region's if there is one, else the viewport's.
inline Viewport ImageSizeOf(const Viewport& viewport, const std::optional<Region>& region) {
  return region.has_value() ? Viewport{region->width_px, region->height_px} : viewport;
}

// Returns the camera of vtkRenderer::ResetCamera: target = centre of `bounds`, eye along +z from it
// at distance R / sin(fov/2), R = half the diagonal, up = +y, fov 30 degrees.
Camera MakeDefaultCamera(const math::Box3d& bounds);

// Turns the eye about `up` through the target (vtkCamera::Azimuth, its sign).
void Azimuth(double radians, Camera* camera);
// Turns the eye about the camera's right axis through the target (vtkCamera::Elevation, its sign),
// and keeps `up` as it is. Callers that turn further orthogonalize first.
void Elevation(double radians, Camera* camera);
// Makes `up` perpendicular to the view direction (vtkCamera::OrthogonalizeViewUp).
void OrthogonalizeUp(Camera* camera);
// Divides the angle (perspective) or the height (orthographic) by `factor` (vtkCamera::Zoom).
// REQUIRES: factor > 0.
void Zoom(double factor, Camera* camera);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_CAMERA_H_
