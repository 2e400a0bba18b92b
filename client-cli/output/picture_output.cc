// Write, for each frame:
//
//   1. Skip a frame that a later one would overwrite: one name without a number.
//   2. Draw the annotations, if any, over the decoded picture, and encode it again.
//   3. Add it to the animation, or
//   4. add the record to the PNG (docs/format/picture.md), and write it to the file or to standard
//      output. Masks and partial pictures have no record, because none could reproduce them.
//
// The record of an annotated picture has the digest of the plain PNG and the boxes that were drawn
// over, so that `render --like` can compare all other pixels.

#include "client-cli/output/picture_output.h"

#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "client-cli/output/frame_name.h"
#include "client-cli/output/output_suffix.h"
#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/label_flags.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "core/image/png_codec.h"
#include "core/io/atomic_file.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"
#include "wire/surface_convert.h"

namespace isoscope::cli {
namespace {

// Of pictures, and of animations (client::IsAnimationName).
constexpr char kPictureSuffixes[] = ".png and .jpg, and .apng and .webp for films";

// Returns true if the request may give pixels that are not opaque.
bool HasAlpha(const isoscope::v1::RenderIsosurfaceRequest& request) {
  if (!request.has_background_color()) {
    return false;
  }
  const absl::StatusOr<image::Rgba8> color =
      wire::ColorFromProto(request.background_color(), "background_color");
  return !color.ok() || color->a != 255;
}

// Returns true if dark ink has more contrast with the background than light ink.
bool IsBackgroundLight(const isoscope::v1::RenderIsosurfaceRequest& request) {
  const isoscope::v1::Color& color = request.background_color();
  // Luma of Rec. 709.
  const float luma = 0.2126F * color.red() + 0.7152F * color.green() + 0.0722F * color.blue();
  return request.has_background_color() && color.alpha() > 0.5F && luma > 0.5F;
}

// "12.5 s", or "step 3" of a dataset without times; empty without steps.
std::string TimeText(const isoscope::v1::Dataset& dataset,
                     const isoscope::v1::RenderIsosurfaceResponse& response) {
  if (response.has_time()) {
    return absl::StrCat(absl::StrFormat("%.9g", response.time()),
                        dataset.time_unit().empty() ? "" : " ", dataset.time_unit());
  }
  return response.has_selection() ? absl::StrCat("step ", response.selection().time_step()) : "";
}

// The title of a legend: field, component and unit; empty of other quantities.
std::string FieldTitle(const isoscope::v1::Dataset& dataset, const frame::ColorBy& color_by) {
  if (color_by.quantity != frame::ColorBy::Quantity::kField) {
    return "";
  }
  const client::FieldValue field{color_by.field, color_by.component};
  const std::string unit = client::UnitOfField(dataset, field);
  return absl::StrCat(client::TitleOfField(dataset, field), unit.empty() ? "" : ", ", unit);
}

// How caps with a colour map were coloured, for a legend.
absl::StatusOr<client::CapsColoring> CapsColoringOf(
    const isoscope::v1::RenderIsosurfaceResponse& response, const isoscope::v1::Dataset& dataset) {
  const isoscope::v1::CapsColoring& proto = response.caps_coloring();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const frame::ClipCaps caps,
      wire::ClipCapsFromProto(proto.caps(), "the response's caps_coloring.caps"));
  const client::FieldValue field{response.selection().field(), response.selection().component()};
  const std::string title = client::TitleOfField(dataset, field);
  const std::string unit = client::UnitOfField(dataset, field);
  client::CapsColoring coloring{.map = caps.map.value_or(frame::ColorMap::kViridis),
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

// Draws the annotations of a frame over `*png`, and tells what the record says of that.
absl::Status AnnotatePng(const client::Annotations& annotations,
                         const isoscope::v1::RenderIsosurfaceRequest& request,
                         const isoscope::v1::RenderIsosurfaceResponse& response,
                         const isoscope::v1::Dataset& dataset, std::string* png,
                         client::AnnotatedPicture* annotated) {
  client::AnnotationScene scene;
  scene.viewport_height_px = request.viewport().height_px();
  for (const isoscope::v1::Surface& surface : request.surfaces()) {
    scene.isovalues.push_back(surface.isovalue());
    scene.label_names.push_back(
        client::NameOfLabels({surface.labels().begin(), surface.labels().end()}, dataset));
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
    client::NameAxes(frame, &scene);
  }
  for (const isoscope::v1::SurfaceColoring& coloring : response.colorings()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const frame::ColorBy color_by,
        wire::ColorByFromProto(coloring.color_by(), "the response's colorings.color_by"));
    client::SurfaceColoring& scene_coloring = scene.colorings.emplace_back();
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
  ISOSCOPE_ASSIGN_OR_RETURN(image::RgbaImage picture, image::DecodePng(*png));
  ISOSCOPE_ASSIGN_OR_RETURN(client::Annotated drawn,
                            client::Annotate(annotations, scene, std::move(picture)));
  annotated->plain_png_sha256 = base::Sha256Hex(*png);
  annotated->boxes = std::move(drawn.boxes);
  *png = image::EncodePng(drawn.picture.width, drawn.picture.height, drawn.picture.pixels);
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckPicturePath(const std::string& path, const view::Viewport& viewport) {
  if (path == kStandardOutput) {
    return absl::OkStatus();
  }
  const std::string first = FrameFileName(path, 0);
  if (client::IsAnimationName(first)) {
    ISOSCOPE_RETURN_IF_ERROR(
        AsUsageError(client::CheckAnimationSize(path, viewport.width_px, viewport.height_px)));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckSuffix(first, ".png", kPictureSuffixes));
  }
  return absl::OkStatus();
}

absl::Status PictureOutput::Write(int index, const isoscope::v1::RenderIsosurfaceRequest& request,
                                  const isoscope::v1::RenderIsosurfaceResponse& response) {
  const std::string path = FrameFileName(options_.path, index);
  const bool is_animation = client::IsAnimationName(path);
  const bool is_kept =
      is_animation || index + 1 == options_.frame_count || HasFrameNumber(options_.path);
  if (!is_kept) {
    return absl::OkStatus();
  }
  std::string png = response.png();
  std::optional<client::AnnotatedPicture> annotated;
  if (options_.annotations.any()) {
    annotated.emplace();
    ISOSCOPE_RETURN_IF_ERROR(
        AnnotatePng(options_.annotations, request, response, options_.dataset, &png, &*annotated));
  }
  last_png_ = png;
  if (options_.path.empty()) {
    return absl::OkStatus();
  }
  if (is_animation) {
    return AddToAnimation(request, png);
  }
  // The picture of the mask depends on the shards, and a partial one on the agents that were
  // available. No record could reproduce it.
  if (!options_.has_metadata || request.culling() == isoscope::v1::CULLING_MASK ||
      response.statistics().missing_shards_size() > 0) {
    return WritePng(path, png);
  }
  client::PictureRecord record{.picture_revision = options_.picture_revision,
                               .samples_digest = options_.dataset.samples_digest(),
                               .request = request,
                               .annotated = std::move(annotated)};
  // The resolved camera needs no fit.
  *record.request.mutable_camera() = response.camera();
  record.request.clear_camera_fit();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string with_record, client::AddPictureRecord(png, record));
  return WritePng(path, with_record);
}

absl::Status PictureOutput::WritePng(const std::string& path, const std::string& png) const {
  if (path != kStandardOutput) {
    return io::WriteFileAtomically(path, png);
  }
  *options_.out << png << std::flush;
  return options_.out->good()
             ? absl::OkStatus()
             : absl::DataLossError("the picture can't be written to standard output");
}

absl::Status PictureOutput::AddToAnimation(const isoscope::v1::RenderIsosurfaceRequest& request,
                                           const std::string& png) {
  if (animation_ == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        animation_,
        client::CreateAnimation(options_.path,
                                {.width_px = request.has_region() ? request.region().width_px()
                                                                  : request.viewport().width_px(),
                                 .height_px = request.has_region() ? request.region().height_px()
                                                                   : request.viewport().height_px(),
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
