// The scene of annotations comes from three places: isovalues, labels and background from the
// request; camera, colours, time and step from the answer; names and units from the dataset.

#include "clients/cpp/connection/annotated_picture.h"

#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/label_flags.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/frame/appearance.h"
#include "core/image/png_codec.h"
#include "core/volume/patient_frame.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"
#include "wire/surface_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

// Returns true if dark ink has more contrast with the background than light ink.
bool IsBackgroundLight(const v1::RenderIsosurfaceRequest& request) {
  const v1::Color& color = request.background_color();
  // Luma of Rec. 709.
  const float luma = 0.2126F * color.red() + 0.7152F * color.green() + 0.0722F * color.blue();
  return request.has_background_color() && color.alpha() > 0.5F && luma > 0.5F;
}

// "12.5 s", or "step 3" of a dataset without times; empty without steps.
std::string TimeText(const v1::Dataset& dataset, const v1::RenderIsosurfaceResponse& response) {
  if (response.has_time()) {
    return absl::StrCat(absl::StrFormat("%.9g", response.time()),
                        dataset.time_unit().empty() ? "" : " ", dataset.time_unit());
  }
  return response.has_selection() ? absl::StrCat("step ", response.selection().time_step()) : "";
}

// The title of a legend: field, component and unit; empty of other quantities.
std::string FieldTitle(const v1::Dataset& dataset, const frame::ColorBy& color_by) {
  if (color_by.quantity != frame::ColorBy::Quantity::kField) {
    return "";
  }
  const FieldValue field{color_by.field, color_by.component};
  const std::string unit = UnitOfField(dataset, field);
  return absl::StrCat(TitleOfField(dataset, field), unit.empty() ? "" : ", ", unit);
}

// How caps with a colour map were coloured, for a legend.
absl::StatusOr<CapsColoring> CapsColoringOf(const v1::RenderIsosurfaceResponse& response,
                                            const v1::Dataset& dataset) {
  const v1::CapsColoring& proto = response.caps_coloring();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const frame::ClipCaps caps,
      wire::ClipCapsFromProto(proto.caps(), "the response's caps_coloring.caps"));
  const FieldValue field{response.selection().field(), response.selection().component()};
  const std::string title = TitleOfField(dataset, field);
  const std::string unit = UnitOfField(dataset, field);
  CapsColoring coloring{.map = caps.map.value_or(frame::ColorMap::kViridis),
                        .range = caps.range.value_or(frame::ColorRange()),
                        .title = absl::StrCat(title.empty() ? "samples" : title, " on cuts",
                                              unit.empty() ? "" : ", ", unit)};
  if (proto.shows_nan()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        coloring.nan_color,
        wire::ColorFromProto(proto.nan_color(), "the response's caps_coloring.nan_color"));
  }
  return coloring;
}

absl::StatusOr<AnnotationScene> SceneOf(const v1::RenderIsosurfaceRequest& request,
                                        const v1::RenderIsosurfaceResponse& response,
                                        const v1::Dataset& dataset) {
  AnnotationScene scene;
  scene.viewport_height_px = request.viewport().height_px();
  for (const v1::Surface& surface : request.surfaces()) {
    scene.isovalues.push_back(surface.isovalue());
    scene.label_names.push_back(
        NameOfLabels({surface.labels().begin(), surface.labels().end()}, dataset));
  }
  if (scene.isovalues.empty()) {
    scene.isovalues.push_back(request.isovalue());
  }
  scene.is_background_light = IsBackgroundLight(request);
  ISOSCOPE_ASSIGN_OR_RETURN(scene.camera, wire::CameraFromProto(response.camera(), "camera"));
  scene.length_unit = dataset.length_unit();
  scene.time = TimeText(dataset, response);
  if (!dataset.patient_frame().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::PatientFrame frame,
                              volume::PatientFrame::FromName(dataset.patient_frame()));
    NameAxes(frame, &scene);
  }
  for (const v1::SurfaceColoring& coloring : response.colorings()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const frame::ColorBy color_by,
        wire::ColorByFromProto(coloring.color_by(), "the response's colorings.color_by"));
    SurfaceColoring& scene_coloring = scene.colorings.emplace_back();
    scene_coloring = {static_cast<std::size_t>(coloring.surface_index()), color_by,
                      FieldTitle(dataset, color_by)};
    if (coloring.shows_nan()) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          scene_coloring.nan_color,
          wire::ColorFromProto(coloring.nan_color(), "the response's colorings.nan_color"));
    }
  }
  if (response.has_caps_coloring()) {
    ISOSCOPE_ASSIGN_OR_RETURN(scene.caps_coloring, CapsColoringOf(response, dataset));
  }
  return scene;
}

}  // namespace

absl::StatusOr<AnnotatedPicture> AnnotatePng(const Annotations& annotations,
                                             const v1::RenderIsosurfaceRequest& request,
                                             const v1::RenderIsosurfaceResponse& response,
                                             const v1::Dataset& dataset, std::string* png) {
  ISOSCOPE_ASSIGN_OR_RETURN(const AnnotationScene scene, SceneOf(request, response, dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(image::RgbaImage picture, image::DecodePng(*png));
  ISOSCOPE_ASSIGN_OR_RETURN(Annotated drawn, Annotate(annotations, scene, std::move(picture)));
  AnnotatedPicture annotated{.plain_png_sha256 = base::Sha256Hex(*png),
                             .boxes = std::move(drawn.boxes)};
  *png = image::EncodePng(drawn.picture.width, drawn.picture.height, drawn.picture.pixels);
  return annotated;
}

absl::StatusOr<std::string> RecordPng(absl::string_view png,
                                      const v1::RenderIsosurfaceRequest& request,
                                      const v1::RenderIsosurfaceResponse& response,
                                      const v1::Dataset& dataset,
                                      const std::string& picture_revision,
                                      std::optional<AnnotatedPicture> annotated) {
  PictureRecord record{.picture_revision = picture_revision,
                       .samples_digest = dataset.samples_digest(),
                       .request = request,
                       .annotated = std::move(annotated)};
  // The resolved camera needs no fit.
  *record.request.mutable_camera() = response.camera();
  record.request.clear_camera_fit();
  record.request.clear_level();
  if (response.drawn_level().level() > 0) {
    record.request.mutable_level()->set_level(response.drawn_level().level());
    record.drawn_level = response.drawn_level();
  }
  return AddPictureRecord(png, record);
}

}  // namespace isoscope::client
