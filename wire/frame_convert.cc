// A request becomes a frame::FrameSpec in this order (FrameSpecFromProto):
//
// 1. Unknown fields are refused (CheckKnownFields).
// 2. Each part is converted by a function that checks its fields: surfaces, window, culling,
//    camera, background, clip region, caps, layers, lights; then output and effects, which agents
//    never get. The first wrong field is the error.
// 3. Checks across fields follow, such as a background that must be opaque for JPEG.
//
// Each error is INVALID_ARGUMENT and names the path of the field, its value and the allowed values.
// Checks that need the dataset come later: ResolveCamera, ResolveCellsCamera, and surface_convert.h.

#include "wire/frame_convert.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "core/view/camera.h"
#include "core/view/camera_fit.h"
#include "core/volume/volume_level.h"
#include "wire/enum_table.h"
#include "wire/first_look.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {

namespace v1 = isoscope::v1;

namespace {

constexpr EnumRow<frame::ImageFormat, v1::OutputOptions::ImageFormat> kImageFormats[] = {
    {frame::ImageFormat::kPng, v1::OutputOptions::IMAGE_FORMAT_PNG},
    {frame::ImageFormat::kPng, v1::OutputOptions::IMAGE_FORMAT_UNSPECIFIED},
    {frame::ImageFormat::kJpeg, v1::OutputOptions::IMAGE_FORMAT_JPEG},
    {frame::ImageFormat::kRgba8, v1::OutputOptions::IMAGE_FORMAT_RGBA8},
    {frame::ImageFormat::kNone, v1::OutputOptions::IMAGE_FORMAT_NONE}};
constexpr EnumRow<frame::BackEnd, isoscope::internal::v1::PictureRevision::BackEnd> kBackEnds[] = {
    {frame::BackEnd::kCpu, isoscope::internal::v1::PictureRevision::BACK_END_CPU},
    {frame::BackEnd::kEgl, isoscope::internal::v1::PictureRevision::BACK_END_EGL}};

absl::StatusOr<view::HalfSpace> HalfSpaceFromProto(const v1::HalfSpace& proto,
                                                   const std::string& path) {
  view::HalfSpace half_space;
  const std::string normal_path = absl::StrCat(path, ".normal");
  ISOSCOPE_ASSIGN_OR_RETURN(half_space.normal, VectorFromProto(proto.normal(), normal_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckLength(half_space.normal, normal_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.offset(), absl::StrCat(path, ".offset")));
  half_space.offset = proto.offset();
  return half_space;
}

absl::StatusOr<math::Box3d> BoxFromProto(const v1::Box& proto, const std::string& path) {
  if (!proto.has_min() || !proto.has_max()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, proto.has_min() ? ".max" : ".min", " is not set: a box needs both"));
  }
  math::Box3d box;
  ISOSCOPE_ASSIGN_OR_RETURN(box.min, VectorFromProto(proto.min(), absl::StrCat(path, ".min")));
  ISOSCOPE_ASSIGN_OR_RETURN(box.max, VectorFromProto(proto.max(), absl::StrCat(path, ".max")));
  for (int axis = 0; axis < 3; ++axis) {
    if (box.min[axis] > box.max[axis]) {
      const char name = "xyz"[axis];
      return absl::InvalidArgumentError(absl::StrCat(
          path, ".max.", std::string(1, name), " is ", box.max[axis], ": must be at least ", path,
          ".min.", std::string(1, name), ", which is ", box.min[axis]));
    }
  }
  return box;
}

absl::StatusOr<frame::OutputSpec> OutputFromProto(const v1::OutputOptions& proto,
                                                  absl::string_view path) {
  frame::OutputSpec output;
  ISOSCOPE_ASSIGN_OR_RETURN(
      output.image_format,
      EnumFromProto(kImageFormats, proto.image_format(), absl::StrCat(path, ".image_format"),
                    "must be 0 (PNG), 1 (PNG), 2 (JPEG), 3 (RGBA8) or 4 (none)"));
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
  output.depth_bounds = proto.depth_bounds();
  if (output.image_format == frame::ImageFormat::kNone && frame::RawBytesPerPixel(output) == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".image_format is 4 (none): must not be without a plane; ask for ", path,
                     ".depth, .surface_index, .position, .normal or .depth_bounds"));
  }
  return output;
}

absl::StatusOr<frame::AmbientOcclusion> AmbientOcclusionFromProto(
    const v1::AmbientOcclusion& proto) {
  frame::AmbientOcclusion occlusion;
  if (proto.radius_px() != 0) {
    if (proto.radius_px() < occlusion.kMinRadiusPx || proto.radius_px() > occlusion.kMaxRadiusPx) {
      return absl::InvalidArgumentError(
          absl::StrCat("ambient_occlusion.radius_px is ", proto.radius_px(), ": must be in [",
                       occlusion.kMinRadiusPx, ", ", occlusion.kMaxRadiusPx,
                       "], or 0 for the default, ", occlusion.radius_px));
    }
    occlusion.radius_px = proto.radius_px();
  }
  if (proto.has_strength()) {
    ISOSCOPE_ASSIGN_OR_RETURN(occlusion.strength,
                              InRange(proto.strength(), 0, 1, "ambient_occlusion.strength"));
  }
  return occlusion;
}

absl::StatusOr<frame::Silhouette> SilhouetteFromProto(const v1::Silhouette& proto) {
  frame::Silhouette silhouette;
  if (proto.width_px() < 0 || proto.width_px() > silhouette.kMaxWidthPx) {
    return absl::InvalidArgumentError(
        absl::StrCat("silhouette.width_px is ", proto.width_px(), ": must be in [1, ",
                     silhouette.kMaxWidthPx, "], or 0 for the default, ", silhouette.width_px));
  }
  if (proto.width_px() != 0) {
    silhouette.width_px = proto.width_px();
  }
  if (proto.has_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(silhouette.color, ColorFromProto(proto.color(), "silhouette.color"));
    if (proto.color().alpha() != 1.0F) {
      return absl::InvalidArgumentError(absl::StrCat(
          "silhouette.color.alpha is ", proto.color().alpha(), ": lines are opaque, must be 1"));
    }
  }
  return silhouette;
}

absl::StatusOr<frame::PictureEffects> EffectsFromProto(const v1::RenderIsosurfaceRequest& request) {
  frame::PictureEffects effects;
  for (effects.samples_per_side = 1; effects.samples() < request.samples() &&
                                     effects.samples_per_side < effects.kMaxSamplesPerSide;) {
    ++effects.samples_per_side;
  }
  if (request.samples() != 0 && effects.samples() != request.samples()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "samples is ", request.samples(), ": must be 1, 4, 9 or 16, or 0 for the default, 1"));
  }
  if (request.has_ambient_occlusion()) {
    ISOSCOPE_ASSIGN_OR_RETURN(effects.ambient_occlusion,
                              AmbientOcclusionFromProto(request.ambient_occlusion()));
  }
  if (request.has_silhouette()) {
    ISOSCOPE_ASSIGN_OR_RETURN(effects.silhouette, SilhouetteFromProto(request.silhouette()));
  }
  return effects;
}

// Viewport and region.
template <typename Message>
absl::Status SetWindow(const Message& proto, frame::FrameSpec* spec) {
  if (!proto.has_viewport()) {
    return absl::InvalidArgumentError("viewport is not set: must say the size of the image");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      spec->viewport,
      ViewportFromProto(proto.viewport(), "viewport",
                        proto.has_region() ? view::kMaxWholeViewportPx : view::kMaxViewportPx));
  if (proto.has_region()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->region,
                              RegionFromProto(proto.region(), spec->viewport, "region"));
  }
  return absl::OkStatus();
}

// Clip region, caps, and the layers of translucent surfaces.
template <typename Message>
absl::Status SetClipAndLayers(const Message& proto, frame::FrameSpec* spec) {
  ISOSCOPE_ASSIGN_OR_RETURN(spec->clip, ClipRegionFromProto(proto.clip(), "clip"));
  if (proto.has_caps()) {
    if (spec->clip.half_spaces.empty() && !spec->clip.box.has_value()) {
      return absl::InvalidArgumentError(
          "caps is set without clip: must be unset, because there is no cut to fill; give "
          "clip.half_spaces or clip.box");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(spec->caps, ClipCapsFromProto(proto.caps(), "caps"));
  }
  if (proto.max_layers() < 0 || proto.max_layers() > frame::kMaxLayers) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_layers is ", proto.max_layers(), ": must lie in [1, ", frame::kMaxLayers,
                     "], or be 0 for the default, ", frame::kDefaultLayers));
  }
  spec->max_layers = proto.max_layers() == 0 ? frame::kDefaultLayers : proto.max_layers();
  return absl::OkStatus();
}

// Agents get numbers: where a range comes from is the coordinator's matter.
template <typename Map>
void KeepNumbers(Map* map) {
  if (map->range().source() != v1::ColorRange::SOURCE_UNSPECIFIED ||
      map->range().has_percentiles()) {
    map->clear_range();
  }
}

// Sets everything that agents draw, from a request or from the internal message. Their fields have
// the same names.
template <typename Message>
absl::Status SetDrawn(const Message& proto, frame::FrameSpec* spec) {
  ISOSCOPE_RETURN_IF_ERROR(SetWindow(proto, spec));
  ISOSCOPE_ASSIGN_OR_RETURN(spec->culling, CullingFromProto(proto.culling(), "culling"));
  if (proto.has_camera()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->camera, CameraFromProto(proto.camera(), "camera"));
  }
  if (proto.has_background_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->background_color,
                              ColorFromProto(proto.background_color(), "background_color"));
  }
  ISOSCOPE_RETURN_IF_ERROR(SetClipAndLayers(proto, spec));
  ISOSCOPE_ASSIGN_OR_RETURN(spec->lights, LightsFromProto(proto.lights()));
  spec->ray_seed = static_cast<std::uint64_t>(proto.ray_seed());
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(const v1::RenderIsosurfaceRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  frame::FrameSpec spec;
  ISOSCOPE_ASSIGN_OR_RETURN(spec.surfaces, SurfacesFromProto(request));
  ISOSCOPE_RETURN_IF_ERROR(SetDrawn(request, &spec));
  if (!v1::CameraFit_IsValid(request.camera_fit())) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera_fit is ", static_cast<int>(request.camera_fit()),
                     ": must be CAMERA_FIT_VOLUME (1), CAMERA_FIT_SURFACE (2) or "
                     "CAMERA_FIT_CELLS (3)"));
  }
  if (request.has_nan_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.nan_color, NanColorFromProto(request.nan_color()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.output, OutputFromProto(request.output(), "output"));
  ISOSCOPE_ASSIGN_OR_RETURN(spec.effects, EffectsFromProto(request));
  if (request.has_level()) {
    ISOSCOPE_RETURN_IF_ERROR(LevelChoiceFromProto(request.level(), "level").status());
  }
  ISOSCOPE_RETURN_IF_ERROR(frame::CheckDrawnWindow(spec));
  ISOSCOPE_RETURN_IF_ERROR(CheckRangesOfRegion(spec));
  if (spec.output.image_format == frame::ImageFormat::kJpeg && spec.background_color.a != 255) {
    return absl::InvalidArgumentError(
        absl::StrCat("background_color.alpha is ", request.background_color().alpha(),
                     ": must be 1 with output.image_format JPEG, which has no transparency"));
  }
  return spec;
}

isoscope::internal::v1::FrameSpec ToProto(const frame::FrameSpec& spec) {
  isoscope::internal::v1::FrameSpec proto;
  for (const frame::Surface& surface : spec.surfaces) {
    v1::Surface& added = *proto.add_surfaces();
    added = ToProto(surface);
    if (added.has_color_by()) {
      KeepNumbers(added.mutable_color_by());
    }
  }
  *proto.mutable_viewport() = ToProto(spec.viewport);
  if (spec.region.has_value()) {
    *proto.mutable_region() = ToProto(*spec.region);
  }
  proto.set_culling(ToProto(spec.culling));
  if (spec.camera.has_value()) {
    *proto.mutable_camera() = ToProto(*spec.camera);
  }
  *proto.mutable_background_color() = ToProto(spec.background_color);
  *proto.mutable_clip() = ToProto(spec.clip);
  if (spec.caps.has_value()) {
    *proto.mutable_caps() = ToProto(*spec.caps);
    KeepNumbers(proto.mutable_caps());
  }
  proto.set_max_layers(spec.max_layers);
  for (const frame::Light& light : spec.lights) {
    *proto.add_lights() = ToProto(light);
  }
  proto.set_ray_seed(static_cast<std::int64_t>(spec.ray_seed));
  proto.set_sends_normals(spec.sends_normals);
  proto.set_sends_map_steps(spec.sends_map_steps);
  proto.set_level(spec.level);
  return proto;
}

absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(
    const isoscope::internal::v1::FrameSpec& proto) {
  frame::FrameSpec spec;
  ISOSCOPE_ASSIGN_OR_RETURN(spec.surfaces, SurfacesFromProto(proto.surfaces()));
  ISOSCOPE_RETURN_IF_ERROR(SetDrawn(proto, &spec));
  spec.sends_normals = proto.sends_normals();
  spec.sends_map_steps = proto.sends_map_steps();
  ISOSCOPE_ASSIGN_OR_RETURN(spec.level, LevelFromProto(proto.level(), "level"));
  return spec;
}

absl::StatusOr<AskedFrame> AskedFrameFromProto(const v1::RenderIsosurfaceRequest& request) {
  AskedFrame asked;
  ISOSCOPE_ASSIGN_OR_RETURN(asked.spec, FrameSpecFromProto(request));
  asked.dataset = request.dataset();
  asked.dataset_id = request.dataset_id();
  if (request.has_selection()) {
    asked.selection = request.selection();
  }
  if (request.camera_fit() != v1::CAMERA_FIT_UNSPECIFIED) {
    asked.fit = request.camera_fit();
  }
  asked.fit_viewport = asked.spec.viewport;
  if (request.has_level()) {
    ISOSCOPE_ASSIGN_OR_RETURN(asked.level, LevelChoiceFromProto(request.level(), "level"));
  }
  asked.with_trace = request.with_trace();
  asked.allow_partial = request.allow_partial();
  asked.with_notes = request.with_notes();
  asked.with_unresolved_count = request.with_unresolved_count();
  return asked;
}

absl::StatusOr<view::ClipRegion> ClipRegionFromProto(const v1::ClipRegion& proto,
                                                     const std::string& path) {
  view::ClipRegion clip;
  if (static_cast<std::size_t>(proto.half_spaces_size()) > view::kMaxHalfSpaces) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".half_spaces has ", proto.half_spaces_size(),
                     " elements: must have at most ", view::kMaxHalfSpaces));
  }
  for (int i = 0; i < proto.half_spaces_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        clip.half_spaces.emplace_back(),
        HalfSpaceFromProto(proto.half_spaces(i), absl::StrCat(path, ".half_spaces[", i, "]")));
  }
  if (proto.has_box()) {
    ISOSCOPE_ASSIGN_OR_RETURN(clip.box, BoxFromProto(proto.box(), absl::StrCat(path, ".box")));
  }
  return clip;
}

v1::ClipRegion ToProto(const view::ClipRegion& clip) {
  v1::ClipRegion proto;
  for (const view::HalfSpace& half_space : clip.half_spaces) {
    v1::HalfSpace* const added = proto.add_half_spaces();
    *added->mutable_normal() = ToProto(half_space.normal);
    added->set_offset(half_space.offset);
  }
  if (clip.box.has_value()) {
    *proto.mutable_box()->mutable_min() = ToProto(clip.box->min);
    *proto.mutable_box()->mutable_max() = ToProto(clip.box->max);
  }
  return proto;
}

absl::StatusOr<int> LevelFromProto(std::int32_t level, absl::string_view path) {
  if (level < 0 || level > volume::kMaxLevel) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is ", level, ": must be 0 to ",
                                                   volume::kMaxLevel,
                                                   "; GetDataset lists the levels of a dataset"));
  }
  return level;
}

absl::StatusOr<view::LevelChoice> LevelChoiceFromProto(const v1::LevelChoice& proto,
                                                       const std::string& path) {
  view::LevelChoice choice;
  switch (proto.choice_case()) {
    case v1::LevelChoice::kLevel: {
      ISOSCOPE_ASSIGN_OR_RETURN(choice.level,
                                LevelFromProto(proto.level(), absl::StrCat(path, ".level")));
      return choice;
    }
    case v1::LevelChoice::kMaxSpacingPx:
      choice.max_spacing_px = proto.max_spacing_px();
      if (!(choice.max_spacing_px > 0) || std::isinf(choice.max_spacing_px)) {
        return absl::InvalidArgumentError(
            absl::StrCat(path, ".max_spacing_px is ", choice.max_spacing_px,
                         ": must be above 0 and finite, in pixels, such as 1.1; leave ", path,
                         " out for level 0"));
      }
      return choice;
    case v1::LevelChoice::CHOICE_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError(absl::StrCat(path, " chooses nothing: set ", path, ".level or ",
                                                 path,
                                                 ".max_spacing_px, or leave it out for level 0"));
}

v1::LevelChoice ToProto(const view::LevelChoice& choice) {
  v1::LevelChoice proto;
  if (choice.level.has_value()) {
    proto.set_level(*choice.level);
  } else {
    proto.set_max_spacing_px(choice.max_spacing_px);
  }
  return proto;
}

absl::StatusOr<ExportSpec> ExportSpecFromProto(const v1::ExportIsosurfaceRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  v1::RenderIsosurfaceRequest frame;
  frame.set_isovalue(request.isovalue());
  *frame.mutable_surfaces() = request.surfaces();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<frame::Surface> surfaces,
                            SurfacesFromProto(frame, kMaxExportedSurfaces));
  ExportSpec spec;
  for (const frame::Surface& surface : surfaces) {
    spec.rules.push_back(surface.rule);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.clip, ClipRegionFromProto(request.clip(), "clip"));
  const auto smooth = std::find_if(spec.rules.begin(), spec.rules.end(),
                                   [](const volume::InsideRule& rule) { return rule.smooths; });
  if (smooth != spec.rules.end() && spec.clip != view::ClipRegion()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "surfaces[", smooth - spec.rules.begin(),
        "].smooth_labels is set beside clip: a smooth mesh can't be cut; leave out one of both"));
  }
  spec.closes = request.closes();
  spec.with_origin = request.with_origin();
  spec.with_measures = request.with_measures();
  spec.without_mesh = request.without_mesh();
  if (spec.without_mesh && !spec.with_measures) {
    return absl::InvalidArgumentError(
        "without_mesh is set and with_measures is not: the answer would be empty");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.level, LevelFromProto(request.level(), "level"));
  if (spec.level > 0 && spec.with_measures) {
    return absl::InvalidArgumentError(absl::StrCat(
        "level is ", spec.level,
        " beside with_measures: measures are of level 0; ask for them without a level"));
  }
  return spec;
}

absl::Status ResolveCamera(const math::Box3d& bounds, frame::FrameSpec* spec,
                           const std::optional<math::Box3d>& surface_bounds) {
  if (spec->camera.has_value() && !surface_bounds.has_value()) {
    return absl::OkStatus();
  }
  const view::Camera camera = !spec->camera.has_value()
                                  ? view::MakeDefaultCamera(surface_bounds.value_or(bounds))
                                  : view::MoveToBox(*spec->camera, bounds, *surface_bounds);
  ISOSCOPE_ASSIGN_OR_RETURN(spec->camera, CameraFromProto(ToProto(camera), "camera"));
  return absl::OkStatus();
}

absl::Status ResolveCellsCamera(const math::Box3d& bounds, const std::optional<math::Box3d>& cells,
                                const std::optional<volume::PatientFrame>& patient_frame,
                                const view::Viewport& viewport, frame::FrameSpec* spec) {
  const view::Camera start =
      spec->camera.has_value() ? *spec->camera : FirstLookCamera(bounds, patient_frame);
  const view::Camera fitted = view::FitToBox(start, viewport, bounds, cells.value_or(bounds));
  ISOSCOPE_ASSIGN_OR_RETURN(spec->camera, CameraFromProto(ToProto(fitted), "camera"));
  return absl::OkStatus();
}

absl::StatusOr<frame::PictureRevision> PictureRevisionFromProto(
    const isoscope::internal::v1::PictureRevision& proto, absl::string_view path) {
  frame::PictureRevision revision{.number = proto.number(), .driver = proto.driver()};
  if (proto.number() < 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".number is ", proto.number(),
                     ": must be at least 1; the agent's version is older than the coordinator's"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      revision.back_end, EnumFromProto(kBackEnds, proto.back_end(), absl::StrCat(path, ".back_end"),
                                       "must be 1 (cpu) or 2 (egl)"));
  return revision;
}

isoscope::internal::v1::PictureRevision ToProto(const frame::PictureRevision& revision) {
  isoscope::internal::v1::PictureRevision proto;
  proto.set_number(revision.number);
  proto.set_back_end(EnumToProto(kBackEnds, revision.back_end));
  proto.set_driver(revision.driver);
  return proto;
}

}  // namespace isoscope::wire
