#include "server/interact/interact_frame.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "absl/strings/str_cat.h"

#include "core/frame/picture_effects.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

std::int32_t Scaled(std::int32_t value, double scale, std::int32_t least) {
  // Values that are out of range stay out of range, so that the checks of every request find them.
  return value <= least ? value
                        : std::max(least, static_cast<std::int32_t>(std::lround(value * scale)));
}

}  // namespace

absl::Status CheckInteractiveOutput(const v1::ViewState& state) {
  const v1::OutputOptions& output = state.frame().output();
  if (output.image_format() != v1::OutputOptions::IMAGE_FORMAT_UNSPECIFIED &&
      output.image_format() != v1::OutputOptions::IMAGE_FORMAT_PNG) {
    return absl::InvalidArgumentError(absl::StrCat("frame.output.image_format is ",
                                                   static_cast<int>(output.image_format()),
                                                   ": must be 0 or 1 (PNG) in a view state"));
  }
  if (state.frame().with_trace()) {
    return absl::InvalidArgumentError(
        "frame.with_trace is set: must be unset in a view state; ask RenderIsosurface for a trace");
  }
  if (state.frame().allow_partial()) {
    return absl::InvalidArgumentError(
        "frame.allow_partial is set: must be unset in a view state, whose pictures are complete");
  }
  if (output.depth() || output.surface_index() || output.position() || output.normal()) {
    return absl::InvalidArgumentError(
        "frame.output asks for a plane: a view state must not; ask RenderIsosurface for planes");
  }
  return absl::OkStatus();
}

v1::RenderIsosurfaceRequest MovingRequest(const v1::RenderIsosurfaceRequest& request,
                                          const MovingQuality& quality) {
  v1::RenderIsosurfaceRequest moving = request;
  moving.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  moving.mutable_output()->set_jpeg_quality(quality.jpeg_quality);
  moving.clear_samples();
  moving.clear_with_notes();
  if (quality.scale >= 1 || request.has_region()) {
    return moving;
  }
  v1::Viewport& viewport = *moving.mutable_viewport();
  viewport.set_width_px(Scaled(viewport.width_px(), quality.scale, 1));
  viewport.set_height_px(Scaled(viewport.height_px(), quality.scale, 1));
  if (moving.has_ambient_occlusion()) {
    v1::AmbientOcclusion& occlusion = *moving.mutable_ambient_occlusion();
    const frame::AmbientOcclusion defaults;
    if (occlusion.radius_px() == 0) {
      occlusion.set_radius_px(defaults.radius_px);
    }
    occlusion.set_radius_px(Scaled(occlusion.radius_px(), quality.scale, defaults.kMinRadiusPx));
  }
  if (moving.has_silhouette()) {
    v1::Silhouette& silhouette = *moving.mutable_silhouette();
    if (silhouette.width_px() == 0) {
      silhouette.set_width_px(frame::Silhouette().width_px);
    }
    silhouette.set_width_px(Scaled(silhouette.width_px(), quality.scale, 1));
  }
  return moving;
}

}  // namespace isoscope::server
