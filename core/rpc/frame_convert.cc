#include "core/rpc/frame_convert.h"

#include <cstdint>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/proto_convert.h"
#include "core/view/camera.h"

namespace isoscope::rpc {
namespace {

absl::StatusOr<frame::Surface> SurfaceFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  frame::Surface surface;
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(request.isovalue(), "isovalue"));
  surface.isovalue = request.isovalue();
  if (request.has_base_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(surface.appearance.base_color,
                              ColorFromProto(request.base_color(), "base_color"));
    if (request.base_color().alpha() != 1.0F) {
      return absl::InvalidArgumentError(absl::StrCat("base_color.alpha is ",
                                                     request.base_color().alpha(),
                                                     ": surfaces are opaque, must be 1"));
    }
  }
  return surface;
}

absl::StatusOr<frame::ImageFormat> ImageFormatFromProto(
    isoscope::v1::OutputOptions::ImageFormat proto, absl::string_view path) {
  using Proto = isoscope::v1::OutputOptions;
  switch (proto) {
    case Proto::IMAGE_FORMAT_UNSPECIFIED:
    case Proto::IMAGE_FORMAT_PNG:
      return frame::ImageFormat::kPng;
    case Proto::IMAGE_FORMAT_JPEG:
      return frame::ImageFormat::kJpeg;
    case Proto::IMAGE_FORMAT_RGBA8:
      return frame::ImageFormat::kRgba8;
    case Proto::IMAGE_FORMAT_NONE:
      return frame::ImageFormat::kNone;
    default:
      return absl::InvalidArgumentError(
          absl::StrCat(path, " is ", static_cast<int>(proto),
                       ": must be 0 (PNG), 1 (PNG), 2 (JPEG), 3 (RGBA8) or 4 (none)"));
  }
}

absl::StatusOr<frame::OutputSpec> OutputFromProto(const isoscope::v1::OutputOptions& proto,
                                                  absl::string_view path) {
  frame::OutputSpec output;
  ISOSCOPE_ASSIGN_OR_RETURN(
      output.image_format,
      ImageFormatFromProto(proto.image_format(), absl::StrCat(path, ".image_format")));
  if (proto.jpeg_quality() < 0 || proto.jpeg_quality() > 100) {
    return absl::InvalidArgumentError(absl::StrCat(path, ".jpeg_quality is ", proto.jpeg_quality(),
                                                   ": must be in [1, 100], or 0 for the default, ",
                                                   frame::kDefaultJpegQuality));
  }
  if (proto.jpeg_quality() != 0) {
    if (output.image_format != frame::ImageFormat::kJpeg) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".jpeg_quality is ",
                                                     proto.jpeg_quality(), ": must be 0 unless ",
                                                     path, ".image_format is 2 (JPEG)"));
    }
    output.jpeg_quality = proto.jpeg_quality();
  }
  output.depth = proto.depth();
  output.surface_index = proto.surface_index();
  output.position = proto.position();
  output.normal = proto.normal();
  if (output.image_format == frame::ImageFormat::kNone && frame::RawBytesPerPixel(output) == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".image_format is 4 (none): must not be without a plane; ask for ", path,
                     ".depth, .surface_index, .position or .normal"));
  }
  return output;
}

}  // namespace

absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  frame::FrameSpec spec;
  ISOSCOPE_ASSIGN_OR_RETURN(const frame::Surface surface, SurfaceFromProto(request));
  spec.surfaces.push_back(surface);
  if (!request.has_viewport()) {
    return absl::InvalidArgumentError("viewport is not set: must say the size of the image");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      spec.viewport,
      ViewportFromProto(request.viewport(), "viewport",
                        request.has_region() ? view::kMaxWholeViewportPx : view::kMaxViewportPx));
  if (request.has_region()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.region,
                              RegionFromProto(request.region(), spec.viewport, "region"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.culling, CullingFromProto(request.culling(), "culling"));
  if (request.has_camera()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.camera, CameraFromProto(request.camera(), "camera"));
  }
  if (request.has_background_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.background_color,
                              ColorFromProto(request.background_color(), "background_color"));
  }
  spec.ray_seed = static_cast<std::uint64_t>(request.ray_seed());
  ISOSCOPE_ASSIGN_OR_RETURN(spec.output, OutputFromProto(request.output(), "output"));
  if (spec.output.image_format == frame::ImageFormat::kJpeg && spec.background_color.a != 255) {
    return absl::InvalidArgumentError(
        absl::StrCat("background_color.alpha is ", request.background_color().alpha(),
                     ": must be 1 with output.image_format JPEG, which has no transparency"));
  }
  return spec;
}

absl::Status ResolveCamera(const math::Box3d& bounds,
                           isoscope::v1::RenderIsosurfaceRequest* request, frame::FrameSpec* spec) {
  if (spec->camera.has_value()) {
    return absl::OkStatus();
  }
  *request->mutable_camera() = ToProto(view::MakeDefaultCamera(bounds));
  ISOSCOPE_ASSIGN_OR_RETURN(spec->camera, CameraFromProto(request->camera(), "camera"));
  return absl::OkStatus();
}

absl::StatusOr<frame::PictureRevision> PictureRevisionFromProto(
    const isoscope::internal::v1::PictureRevision& proto, absl::string_view path) {
  using Proto = isoscope::internal::v1::PictureRevision;
  frame::PictureRevision revision{.number = proto.number(), .driver = proto.driver()};
  if (proto.number() < 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".number is ", proto.number(),
                     ": must be at least 1; the agent's version is older than the coordinator's"));
  }
  switch (proto.back_end()) {
    case Proto::BACK_END_CPU:
      revision.back_end = frame::BackEnd::kCpu;
      return revision;
    case Proto::BACK_END_EGL:
      revision.back_end = frame::BackEnd::kEgl;
      return revision;
    default:
      return absl::InvalidArgumentError(absl::StrCat(path, ".back_end is ",
                                                     static_cast<int>(proto.back_end()),
                                                     ": must be 1 (cpu) or 2 (egl)"));
  }
}

isoscope::internal::v1::PictureRevision ToProto(const frame::PictureRevision& revision) {
  using Proto = isoscope::internal::v1::PictureRevision;
  Proto proto;
  proto.set_number(revision.number);
  proto.set_back_end(revision.back_end == frame::BackEnd::kCpu ? Proto::BACK_END_CPU
                                                               : Proto::BACK_END_EGL);
  proto.set_driver(revision.driver);
  return proto;
}

}  // namespace isoscope::rpc
