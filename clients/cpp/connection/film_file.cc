#include "clients/cpp/connection/film_file.h"

#include "core/image/png_codec.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

// Returns true if the request may give pixels that are not opaque.
bool HasAlpha(const isoscope::v1::RenderIsosurfaceRequest& request) {
  if (!request.has_background_color()) {
    return false;
  }
  const absl::StatusOr<image::Rgba8> color =
      wire::ColorFromProto(request.background_color(), "background_color");
  return !color.ok() || color->a != 255;
}

}  // namespace

absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateFilm(
    const std::string& path, const isoscope::v1::RenderIsosurfaceRequest& request, int frame_count,
    double fps) {
  const bool is_part = request.has_region();
  return CreateAnimation(
      path, {.width_px = is_part ? request.region().width_px() : request.viewport().width_px(),
             .height_px = is_part ? request.region().height_px() : request.viewport().height_px(),
             .frame_count = frame_count,
             .fps = fps,
             .has_alpha = HasAlpha(request)});
}

}  // namespace isoscope::client
