#include "core/rpc/frame_convert.h"

#include <cstdint>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/proto_convert.h"
#include "core/view/camera.h"
#include "core/view/camera_fit.h"

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
  ISOSCOPE_ASSIGN_OR_RETURN(spec.viewport, ViewportFromProto(request.viewport(), "viewport"));
  ISOSCOPE_ASSIGN_OR_RETURN(spec.culling, CullingFromProto(request.culling(), "culling"));
  if (request.has_camera()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.camera, CameraFromProto(request.camera(), "camera"));
  }
  if (!isoscope::v1::CameraFit_IsValid(request.camera_fit())) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera_fit is ", static_cast<int>(request.camera_fit()),
                     ": must be CAMERA_FIT_VOLUME (1) or CAMERA_FIT_SURFACE (2)"));
  }
  if (request.has_background_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.background_color,
                              ColorFromProto(request.background_color(), "background_color"));
  }
  spec.ray_seed = static_cast<std::uint64_t>(request.ray_seed());
  return spec;
}

absl::Status ResolveCamera(const math::Box3d& bounds,
                           isoscope::v1::RenderIsosurfaceRequest* request, frame::FrameSpec* spec,
                           const std::optional<math::Box3d>& surface_bounds) {
  request->clear_camera_fit();
  if (spec->camera.has_value() && !surface_bounds.has_value()) {
    return absl::OkStatus();
  }
  *request->mutable_camera() =
      ToProto(!spec->camera.has_value() ? view::MakeDefaultCamera(surface_bounds.value_or(bounds))
                                        : view::MoveToBox(*spec->camera, bounds, *surface_bounds));
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
