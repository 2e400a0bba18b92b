#include "server/interact/interact_frame.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "wire/color_range_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// The sizes that are tried for a moving frame that would be drawn in bands. The least is that of
// the largest picture, with layers, and the least memory limit.
constexpr double kSmallerBy = 0.75;
constexpr double kLeastScale = 1.0 / 64;

frame::FrameSpec Scaled(frame::FrameSpec spec, double scale) {
  if (scale < 1) {
    const auto scaled = [&](int px) {
      return std::max(1, static_cast<int>(std::lround(px * scale)));
    };
    spec.viewport = {scaled(spec.viewport.width_px), scaled(spec.viewport.height_px)};
    spec.effects = spec.effects.Scaled(scale);
  }
  return spec;
}

// INVALID_ARGUMENT if a state asks for an output that no stream has.
absl::Status CheckOutput(const v1::ViewState& state) {
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
  if (output.depth() || output.surface_index() || output.position() || output.normal() ||
      output.depth_bounds()) {
    return absl::InvalidArgumentError(
        "frame.output asks for a plane: a view state must not; ask RenderIsosurface for planes");
  }
  return absl::OkStatus();
}

// INVALID_ARGUMENT also for a range that would change with the view, and let colours flicker.
absl::StatusOr<wire::AskedFrame> ConvertFrame(const v1::RenderIsosurfaceRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(wire::AskedFrame asked, wire::AskedFrameFromProto(request));
  if (wire::HasVisibleRanges(asked.spec)) {
    return absl::InvalidArgumentError(
        "a range of frame has source 2 (visible): must have another one in a view state; ask "
        "RenderIsosurface, and give the range that its answer has");
  }
  return asked;
}

// The bytes of all but the camera.
std::string WithoutCamera(v1::RenderIsosurfaceRequest frame) {
  frame.clear_camera();
  frame.clear_camera_fit();
  return frame.SerializeAsString();
}

}  // namespace

MovingQuality RestQualityOf(MovingQuality moving) {
  moving.scale = 1;
  if (moving.jpeg_quality >= MovingQuality().jpeg_quality) {
    moving.jpeg_quality = kRestJpegQuality;
  }
  return moving;
}

// Cameras are compared as numbers: a client may have written -0 as 0.
bool HasToldCamera(const v1::RenderIsosurfaceRequest& frame, const v1::Camera& told,
                   const v1::RenderIsosurfaceRequest& next) {
  const bool is_taken_as_it_is =
      next.camera_fit() == v1::CAMERA_FIT_UNSPECIFIED || next.camera_fit() == v1::CAMERA_FIT_VOLUME;
  if (!next.has_camera() || !is_taken_as_it_is || WithoutCamera(frame) != WithoutCamera(next)) {
    return false;
  }
  const absl::StatusOr<view::Camera> of_next = wire::CameraFromProto(next.camera(), "camera");
  const absl::StatusOr<view::Camera> of_frame = wire::CameraFromProto(told, "camera");
  return of_next.ok() && of_frame.ok() && *of_next == *of_frame;
}

absl::StatusOr<wire::AskedFrame> ExactFrameOf(const v1::ViewState& state) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOutput(state));
  return ConvertFrame(state.frame());
}

absl::StatusOr<wire::AskedFrame> MovingFrameOf(const v1::ViewState& state,
                                               const MovingQuality& quality) {
  return MovingFrameOf(state, quality, [](const frame::FrameSpec&) { return true; });
}

absl::StatusOr<wire::AskedFrame> MovingFrameOf(
    const v1::ViewState& state, const MovingQuality& quality,
    absl::FunctionRef<bool(const frame::FrameSpec& spec)> is_drawn_at_once) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOutput(state));
  v1::RenderIsosurfaceRequest request = state.frame();
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  request.mutable_output()->set_jpeg_quality(quality.jpeg_quality);
  ISOSCOPE_ASSIGN_OR_RETURN(wire::AskedFrame moving, ConvertFrame(request));
  moving.with_notes = false;
  moving.with_unresolved_count = false;
  moving.spec.effects.samples_per_side = 1;
  if (moving.spec.region.has_value()) {
    return moving;
  }
  const frame::FrameSpec whole = moving.spec;
  moving.spec = Scaled(whole, quality.scale);
  for (double scale = quality.scale * kSmallerBy;
       scale >= kLeastScale && !is_drawn_at_once(moving.spec); scale *= kSmallerBy) {
    moving.spec = Scaled(whole, scale);
  }
  return moving;
}

}  // namespace isoscope::server
