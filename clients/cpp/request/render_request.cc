// Flags become the surfaces of a request:
//
//   --isovalue V --color C     isovalue V, base_color C
//   --surface V:C ...          surfaces: V with C, ...
//   --label SET ...            surfaces: SET, ...
//   --isovalue V --label SET   surfaces: V, SET; PromoteIsovalue turns V and its colour into the
//                              first one
//
// CheckSurfaces has refused --surface with --isovalue or --color. An export has the same surfaces
// without colours.

#include "clients/cpp/request/render_request.h"

#include <cstddef>

#include "absl/strings/str_cat.h"

#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/look_flags.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/frame/frame_spec.h"
#include "core/view/clip_region.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

absl::StatusOr<std::int64_t> ParseSide(absl::string_view text) {
  return ParseInteger(text, 1, view::kMaxWholeViewportPx);
}

absl::StatusOr<frame::Culling> ParseCulling(absl::string_view text) {
  return ParseChoice<frame::Culling>(text, {{"depth", frame::Culling::kDepth},
                                            {"mask", frame::Culling::kMask},
                                            {"none", frame::Culling::kNone}});
}

absl::StatusOr<std::int64_t> ParseLayers(absl::string_view text) {
  return ParseInteger(text, 1, frame::kMaxLayers);
}

// Adds the surfaces of labels. A single isovalue becomes a surface before them.
void AddLabels(bool has_isovalue, const LabelFlags& label,
               isoscope::v1::RenderIsosurfaceRequest* request) {
  if (label.surfaces.empty()) {
    return;
  }
  if (has_isovalue) {
    PromoteIsovalue(request);
  }
  for (const LabelSurface& surface : label.surfaces) {
    AddTo(surface, request->add_surfaces());
  }
}

}  // namespace

void PromoteIsovalue(isoscope::v1::RenderIsosurfaceRequest* request) {
  if (!request->surfaces().empty()) {
    return;
  }
  isoscope::v1::Surface* const surface = request->add_surfaces();
  surface->set_isovalue(request->isovalue());
  request->clear_isovalue();
  if (request->has_base_color()) {
    *surface->mutable_color() = request->base_color();
    request->clear_base_color();
  }
}

void PromoteIsovalue(isoscope::v1::ExportIsosurfaceRequest* request) {
  if (request->surfaces().empty()) {
    request->add_surfaces()->set_isovalue(request->isovalue());
    request->clear_isovalue();
  }
}

isoscope::v1::Color ToProto(const frame::Color& color) {
  isoscope::v1::Color proto;
  proto.set_red(color.red);
  proto.set_green(color.green);
  proto.set_blue(color.blue);
  proto.set_alpha(color.alpha);
  return proto;
}

void AddRequestFlags(cli::FlagSet* set, RequestFlags* flags) {
  cli::AddFlag(set, "--isovalue", "V", &flags->isovalue, ParseNumber,
               "the isovalue, in field units");
  cli::AddRepeatableFlag(
      set, "--surface", "V[:COLOR[:OPACITY]]", &flags->surfaces, ParseSurface,
      "a surface: its isovalue, colour and opacity (below 1: translucent); instead of "
      "--isovalue and --color, up to 128 times");
  AddLabelFlags(set, &flags->label);
  cli::AddFlag(
      set, "--max-layers", "N", &flags->max_layers, ParseLayers,
      "translucent fragments that show in a pixel, the nearest ones, 1 to 16 (default: 8)");
  cli::AddFlag(set, "--width", "W", &flags->width, ParseSide,
               "pixels, up to 65536 (default: 1024)");
  cli::AddFlag(set, "--height", "H", &flags->height, ParseSide,
               "pixels, up to 65536 (default: 1024)");
  cli::AddFlag(set, "--region", "X,Y,W,H", &flags->region, ParseRegion,
               "only this window of the picture, in its pixels, with exactly its pixels");
  cli::AddFlag(set, "--culling", "depth|mask|none", &flags->culling, ParseCulling,
               "how hidden blocks are left out: depth (default) keeps the picture exact, mask is "
               "approximate, none draws all");
  cli::AddFlag(set, "--color", "COLOR", &flags->base_color, ParseColor,
               "colour of the surface: a name of CSS as teal, #RRGGBB, or R,G,B from 0 to 1 "
               "(default: a light clay)");
  cli::AddFlag(set, "--background", "COLOR", &flags->background_color, ParseColorWithAlpha,
               "colour behind it, as of --color, or with an alpha: #RRGGBBAA, R,G,B,A (default: "
               "black)");
  AddClipFlags(set, &flags->clip);
  cli::AddFlagWithDefault(
      set, "--caps", "[MAP[:MIN,MAX]]", &flags->caps, ParseCaps,
      "fill the cuts of --clip-plane and --clip-box through opaque surfaces, with "
      "their colour, or with the samples through a map of --color-by (default "
      "range: that of the finite samples, over all steps)");
  AddSelectionFlags(set, &flags->selection);
  AddCameraFlags(set, &flags->camera);
}

std::vector<double> RequestFlags::isovalues() const {
  if (surfaces.empty() && (isovalue || label.empty())) {
    return {isovalue.value_or(0)};
  }
  std::vector<double> values;
  for (const SurfaceValue& surface : surfaces) {
    values.push_back(surface.isovalue);
  }
  return values;
}

absl::Status CheckSurfaces(const std::optional<double>& isovalue,
                           const std::vector<SurfaceValue>& surfaces,
                           const std::optional<frame::Color>& color, const LabelFlags& label,
                           std::size_t max_surfaces) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(label, max_surfaces));
  if (!isovalue && surfaces.empty() && label.empty()) {
    return cli::UsageError(
        "--isovalue V is missing: the level of the surface, in field units; "
        "`isoscope info INPUT --histogram` suggests some; of a segmentation --label SET");
  }
  if (!isovalue && surfaces.empty() && color) {
    return cli::UsageError(
        "--color is that of --isovalue: write --label SET:COLOR for a surface of labels");
  }
  if (!surfaces.empty() && (isovalue || color)) {
    return cli::UsageError(
        absl::StrCat("--surface and ", isovalue ? "--isovalue" : "--color",
                     " exclude each other: write --surface V:COLOR for each surface"));
  }
  if (surfaces.size() > max_surfaces) {
    return cli::UsageError(absl::StrCat("--surface is given ", surfaces.size(), " times: at most ",
                                        max_surfaces, " are allowed"));
  }
  if (const std::size_t count = (isovalue ? 1 : 0) + surfaces.size() + label.surface_count();
      count > max_surfaces) {
    return cli::UsageError(absl::StrCat("there are ", count,
                                        " surfaces of isovalues and labels together: at most ",
                                        max_surfaces, " are allowed"));
  }
  return absl::OkStatus();
}

absl::Status CheckUsage(const RequestFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(
      CheckSurfaces(flags.isovalue, flags.surfaces, flags.base_color, flags.label));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.clip));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.selection));
  if (flags.region) {
    if (const absl::Status status = view::Validate(flags.viewport(), flags.region); !status.ok()) {
      return cli::UsageError(absl::StrCat("--region: ", status.message()));
    }
  }
  if (flags.caps && flags.clip.empty()) {
    return cli::UsageError(
        "--caps fills the cuts of --clip-plane and --clip-box: give at least one");
  }
  return CheckUsage(flags.camera);
}

isoscope::v1::RenderIsosurfaceRequest MakeRequest(const RequestFlags& flags,
                                                  const std::string& dataset,
                                                  const view::Camera& camera) {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_dataset(dataset);
  request.set_isovalue(flags.isovalue.value_or(0));
  for (const SurfaceValue& surface : flags.surfaces) {
    isoscope::v1::Surface* const proto = request.add_surfaces();
    proto->set_isovalue(surface.isovalue);
    if (surface.color) {
      *proto->mutable_color() = ToProto(*surface.color);
    }
  }
  if (flags.base_color) {
    *request.mutable_base_color() = ToProto(*flags.base_color);
  }
  AddLabels(flags.isovalue.has_value(), flags.label, &request);
  if (const auto selection = ToProto(flags.selection)) {
    *request.mutable_selection() = *selection;
  }
  request.set_max_layers(static_cast<std::int32_t>(flags.max_layers.value_or(0)));
  if (!flags.clip.empty()) {
    *request.mutable_clip() = ToProto(flags.clip);
  }
  if (flags.caps) {
    *request.mutable_caps() = wire::ToProto(*flags.caps);
  }
  *request.mutable_camera() = wire::ToProto(camera);
  request.mutable_viewport()->set_width_px(flags.viewport().width_px);
  request.mutable_viewport()->set_height_px(flags.viewport().height_px);
  if (flags.region) {
    *request.mutable_region() = wire::ToProto(*flags.region);
  }
  request.set_culling(wire::ToProto(flags.culling.value_or(frame::Culling::kDepth)));
  if (flags.background_color) {
    *request.mutable_background_color() = ToProto(*flags.background_color);
  }
  return request;
}

absl::StatusOr<isoscope::v1::RenderIsosurfaceRequest> MakeRequest(
    const RequestFlags& flags, const std::string& dataset, const isoscope::v1::Camera& camera,
    const std::optional<isoscope::v1::CameraFit>& fit) {
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera checked, wire::CameraFromProto(camera, "camera"));
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest(flags, dataset, checked);
  *request.mutable_camera() = camera;
  if (fit) {
    request.set_camera_fit(*fit);
  }
  return request;
}

isoscope::v1::ExportIsosurfaceRequest MakeExportRequest(const std::optional<double>& isovalue,
                                                        const std::vector<SurfaceValue>& surfaces,
                                                        const ClipFlags& clip,
                                                        const std::string& dataset,
                                                        const LabelFlags& label) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_dataset(dataset);
  request.set_isovalue(isovalue.value_or(0));
  for (const SurfaceValue& surface : surfaces) {
    request.add_surfaces()->set_isovalue(surface.isovalue);
  }
  if (!label.surfaces.empty() && isovalue) {
    PromoteIsovalue(&request);
  }
  for (const LabelSurface& surface : label.surfaces) {
    AddTo(surface, request.add_surfaces());
  }
  if (!clip.empty()) {
    *request.mutable_clip() = ToProto(clip);
  }
  return request;
}

}  // namespace isoscope::client
