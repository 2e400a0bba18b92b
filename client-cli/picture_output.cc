#include "client-cli/picture_output.h"

#include "client-cli/output.h"
#include "client-cli/png_metadata.h"
#include "client-cli/render_request.h"
#include "core/base/status_macros.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::cli {
namespace {

// True if the request can give pixels that are not opaque.
bool HasAlpha(const isoscope::v1::RenderIsosurfaceRequest& request) {
  if (!request.has_background_color()) {
    return false;
  }
  const absl::StatusOr<image::Rgba8> color =
      rpc::ColorFromProto(request.background_color(), "background_color");
  return !color.ok() || color->a != 255;
}

}  // namespace

absl::Status CheckPicturePath(const std::string& path, const view::Viewport& viewport) {
  const std::string first = FrameFileName(path, 0);
  if (IsAnimationName(first)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckAnimationSize(path, viewport.width_px, viewport.height_px));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckSuffix(first, ".png", "PNG"));
  }
  return absl::OkStatus();
}

absl::Status PictureOutput::Write(int index, const isoscope::v1::RenderIsosurfaceRequest& request,
                                  const isoscope::v1::RenderIsosurfaceResponse& response) {
  const std::string path = FrameFileName(options_.path, index);
  if (IsAnimationName(path)) {
    return AddToAnimation(request, response.png());
  }
  const bool is_kept =
      index + 1 == options_.frame_count || path != FrameFileName(options_.path, index + 1);
  if (!is_kept) {
    return absl::OkStatus();
  }
  // The picture of the mask depends on how the volume was cut: no record could make it again.
  if (!options_.has_metadata || request.culling() == isoscope::v1::CULLING_MASK) {
    return WriteFileAtomically(path, response.png());
  }
  PictureRecord record{.picture_revision = options_.picture_revision,
                       .samples_digest = options_.samples_digest,
                       .request = request};
  *record.request.mutable_camera() = response.camera();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string png, AddPictureRecord(response.png(), record));
  return WriteFileAtomically(path, png);
}

absl::Status PictureOutput::AddToAnimation(const isoscope::v1::RenderIsosurfaceRequest& request,
                                           const std::string& png) {
  if (animation_ == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        animation_, CreateAnimation(options_.path, {.width_px = request.viewport().width_px(),
                                                    .height_px = request.viewport().height_px(),
                                                    .frame_count = options_.frame_count,
                                                    .fps = options_.fps,
                                                    .has_alpha = HasAlpha(request)}));
  }
  return animation_->AddFrame(png);
}

absl::Status PictureOutput::Finish() {
  return animation_ != nullptr ? animation_->Finish() : absl::OkStatus();
}

}  // namespace isoscope::cli
