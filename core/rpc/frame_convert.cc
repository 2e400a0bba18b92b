#include "core/rpc/frame_convert.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/proto_convert.h"
#include "core/view/camera.h"
#include "core/view/camera_fit.h"

namespace isoscope::rpc {
namespace {

constexpr float kMaxShininess = 1000;

absl::Status SetColor(const isoscope::v1::Color& proto, absl::string_view path,
                      frame::Surface* surface) {
  ISOSCOPE_ASSIGN_OR_RETURN(image::Rgba8 color, ColorFromProto(proto, path));
  if (!(proto.alpha() > 0)) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".alpha is ", proto.alpha(),
                     ": the opacity of a surface must lie in (0, 1]; 1 is opaque"));
  }
  color.a = 255;
  surface->appearance.base_color = color;
  surface->opacity = proto.alpha();
  return absl::OkStatus();
}

// Also refuses NaN.
absl::Status CheckRange(float value, float min, float max, const std::string& path) {
  if (value >= min && value <= max) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, " is ", value, ": must lie in [", min, ", ", max, "]"));
}

absl::Status CheckLength(const math::Vec3d& v, const std::string& path) {
  const double length = math::Length(v);
  if (length > 0 && std::isfinite(length)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, " is (", v.x, ", ", v.y, ", ", v.z,
                   "): must have a length that is neither 0 nor infinite"));
}

absl::Status SetMaterial(const isoscope::v1::Material& proto, const std::string& path,
                         frame::Appearance* appearance) {
  if (proto.has_ambient()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(proto.ambient(), 0, 1, absl::StrCat(path, ".ambient")));
    appearance->ambient = proto.ambient();
  }
  if (proto.has_diffuse()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(proto.diffuse(), 0, 1, absl::StrCat(path, ".diffuse")));
    appearance->diffuse = proto.diffuse();
  }
  if (proto.has_specular()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(proto.specular(), 0, 1, absl::StrCat(path, ".specular")));
    appearance->specular = proto.specular();
  }
  if (proto.has_shininess()) {
    ISOSCOPE_RETURN_IF_ERROR(
        CheckRange(proto.shininess(), 1, kMaxShininess, absl::StrCat(path, ".shininess")));
    appearance->shininess = proto.shininess();
  }
  return absl::OkStatus();
}

absl::StatusOr<frame::ColorMap> ColorMapFromProto(isoscope::v1::ColorMap proto,
                                                  const std::string& path) {
  switch (proto) {
    case isoscope::v1::COLOR_MAP_UNSPECIFIED:
    case isoscope::v1::COLOR_MAP_VIRIDIS:
      return frame::ColorMap::kViridis;
    case isoscope::v1::COLOR_MAP_MAGMA:
      return frame::ColorMap::kMagma;
    case isoscope::v1::COLOR_MAP_CIVIDIS:
      return frame::ColorMap::kCividis;
    case isoscope::v1::COLOR_MAP_TURBO:
      return frame::ColorMap::kTurbo;
    case isoscope::v1::COLOR_MAP_COOL_WARM:
      return frame::ColorMap::kCoolWarm;
    case isoscope::v1::COLOR_MAP_GREY:
      return frame::ColorMap::kGrey;
    default:
      return absl::InvalidArgumentError(absl::StrCat(
          path, " is ", static_cast<int>(proto),
          ": must be 0 or 1 (viridis), 2 (magma), 3 (cividis), 4 (turbo), 5 (cool-warm) "
          "or 6 (grey)"));
  }
}

absl::StatusOr<frame::ColorBy::Quantity> QuantityFromProto(isoscope::v1::ColorBy::Quantity proto,
                                                           const std::string& path) {
  using Proto = isoscope::v1::ColorBy;
  switch (proto) {
    case Proto::QUANTITY_POSITION_X:
      return frame::ColorBy::Quantity::kPositionX;
    case Proto::QUANTITY_POSITION_Y:
      return frame::ColorBy::Quantity::kPositionY;
    case Proto::QUANTITY_POSITION_Z:
      return frame::ColorBy::Quantity::kPositionZ;
    case Proto::QUANTITY_NORMAL:
      return frame::ColorBy::Quantity::kNormal;
    case Proto::QUANTITY_GRADIENT_MAGNITUDE:
      return frame::ColorBy::Quantity::kGradientMagnitude;
    default:
      return absl::InvalidArgumentError(
          absl::StrCat(path, " is ", static_cast<int>(proto),
                       ": must be 1 (position x), 2 (position y), 3 (position z), 4 (normal) or 5 "
                       "(gradient magnitude)"));
  }
}

absl::StatusOr<frame::ColorRange> ColorRangeFromProto(const isoscope::v1::ColorRange& proto,
                                                      const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.min(), absl::StrCat(path, ".min")));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.max(), absl::StrCat(path, ".max")));
  if (!(proto.max() > proto.min()) || !std::isfinite(proto.max() - proto.min())) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".max is ", proto.max(), ": must be greater than ", path,
                     ".min, which is ", proto.min(), ", by a number that is finite"));
  }
  return frame::ColorRange{.min = proto.min(), .max = proto.max()};
}

absl::StatusOr<frame::ClipCaps> ClipCapsFromProto(const isoscope::v1::ClipCaps& proto,
                                                  const std::string& path) {
  frame::ClipCaps caps;
  if (proto.color_map() == isoscope::v1::COLOR_MAP_UNSPECIFIED) {
    if (proto.has_range()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ".range is set without ", path,
                       ".color_map, whose values it is the range of: must be unset"));
    }
    return caps;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(caps.map,
                            ColorMapFromProto(proto.color_map(), absl::StrCat(path, ".color_map")));
  if (proto.has_range()) {
    ISOSCOPE_ASSIGN_OR_RETURN(caps.range,
                              ColorRangeFromProto(proto.range(), absl::StrCat(path, ".range")));
  }
  return caps;
}

absl::StatusOr<frame::Light> LightFromProto(const isoscope::v1::Light& proto,
                                            const std::string& path) {
  frame::Light light;
  const std::string direction_path = absl::StrCat(path, ".direction");
  ISOSCOPE_ASSIGN_OR_RETURN(light.direction, VectorFromProto(proto.direction(), direction_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckLength(light.direction, direction_path));
  switch (proto.space()) {
    case isoscope::v1::Light::SPACE_UNSPECIFIED:
    case isoscope::v1::Light::SPACE_VIEW:
      light.space = frame::Light::Space::kView;
      break;
    case isoscope::v1::Light::SPACE_WORLD:
      light.space = frame::Light::Space::kWorld;
      break;
    default:
      return absl::InvalidArgumentError(absl::StrCat(path, ".space is ",
                                                     static_cast<int>(proto.space()),
                                                     ": must be 0 (view), 1 (view) or 2 (world)"));
  }
  if (proto.has_intensity()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(proto.intensity(), 0, frame::kMaxLightIntensity,
                                        absl::StrCat(path, ".intensity")));
    light.intensity = proto.intensity();
  }
  if (proto.has_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(light.color,
                              ColorFromProto(proto.color(), absl::StrCat(path, ".color")));
    if (proto.color().alpha() != 1.0F) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, ".color.alpha is ", proto.color().alpha(), ": lights have no opacity, must be 1"));
    }
  }
  return light;
}

absl::StatusOr<std::vector<frame::Light>> LightsFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  if (static_cast<std::size_t>(request.lights_size()) > frame::kMaxLights) {
    return absl::InvalidArgumentError(absl::StrCat(
        "lights has ", request.lights_size(), " elements: must have at most ", frame::kMaxLights));
  }
  std::vector<frame::Light> lights;
  for (int i = 0; i < request.lights_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(lights.emplace_back(),
                              LightFromProto(request.lights(i), absl::StrCat("lights[", i, "]")));
  }
  return lights;
}

absl::StatusOr<frame::Surface> SurfaceFromProto(const isoscope::v1::Surface& proto,
                                                const std::string& path) {
  frame::Surface surface;
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.isovalue(), absl::StrCat(path, ".isovalue")));
  surface.isovalue = proto.isovalue();
  if (proto.has_color()) {
    ISOSCOPE_RETURN_IF_ERROR(SetColor(proto.color(), absl::StrCat(path, ".color"), &surface));
  }
  ISOSCOPE_RETURN_IF_ERROR(
      SetMaterial(proto.material(), absl::StrCat(path, ".material"), &surface.appearance));
  if (proto.has_color_by()) {
    ISOSCOPE_ASSIGN_OR_RETURN(surface.color_by,
                              ColorByFromProto(proto.color_by(), absl::StrCat(path, ".color_by")));
  }
  return surface;
}

// The surface of a request that lists none.
absl::StatusOr<frame::Surface> OnlySurfaceFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  frame::Surface surface;
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(request.isovalue(), "isovalue"));
  surface.isovalue = request.isovalue();
  if (request.has_base_color()) {
    ISOSCOPE_RETURN_IF_ERROR(SetColor(request.base_color(), "base_color", &surface));
  }
  return surface;
}

absl::StatusOr<std::vector<frame::Surface>> SurfacesFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  std::vector<frame::Surface> surfaces;
  if (request.surfaces().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(surfaces.emplace_back(), OnlySurfaceFromProto(request));
    return surfaces;
  }
  if (request.isovalue() != 0 || request.has_base_color()) {
    return absl::InvalidArgumentError(
        absl::StrCat(request.has_base_color() ? "base_color" : "isovalue",
                     " is set beside surfaces: must be unset, because each surface has its own"));
  }
  if (static_cast<std::size_t>(request.surfaces_size()) > frame::kMaxSurfaces) {
    return absl::InvalidArgumentError(absl::StrCat("surfaces has ", request.surfaces_size(),
                                                   " elements: must have at most ",
                                                   frame::kMaxSurfaces));
  }
  for (int i = 0; i < request.surfaces_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        surfaces.emplace_back(),
        SurfaceFromProto(request.surfaces(i), absl::StrCat("surfaces[", i, "]")));
  }
  return surfaces;
}

absl::StatusOr<view::HalfSpace> HalfSpaceFromProto(const isoscope::v1::HalfSpace& proto,
                                                   const std::string& path) {
  view::HalfSpace half_space;
  const std::string normal_path = absl::StrCat(path, ".normal");
  ISOSCOPE_ASSIGN_OR_RETURN(half_space.normal, VectorFromProto(proto.normal(), normal_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckLength(half_space.normal, normal_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.offset(), absl::StrCat(path, ".offset")));
  half_space.offset = proto.offset();
  return half_space;
}

absl::StatusOr<math::Box3d> BoxFromProto(const isoscope::v1::Box& proto, const std::string& path) {
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

absl::StatusOr<frame::AmbientOcclusion> AmbientOcclusionFromProto(
    const isoscope::v1::AmbientOcclusion& proto) {
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
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(proto.strength(), 0, 1, "ambient_occlusion.strength"));
    occlusion.strength = proto.strength();
  }
  return occlusion;
}

absl::StatusOr<frame::Silhouette> SilhouetteFromProto(const isoscope::v1::Silhouette& proto) {
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

absl::StatusOr<frame::PictureEffects> EffectsFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
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

}  // namespace

absl::StatusOr<frame::ColorBy> ColorByFromProto(const isoscope::v1::ColorBy& proto,
                                                absl::string_view path) {
  frame::ColorBy color_by;
  ISOSCOPE_ASSIGN_OR_RETURN(color_by.quantity,
                            QuantityFromProto(proto.quantity(), absl::StrCat(path, ".quantity")));
  if (color_by.quantity == frame::ColorBy::Quantity::kNormal &&
      (proto.color_map() != isoscope::v1::COLOR_MAP_UNSPECIFIED || proto.has_range() ||
       proto.has_opacity())) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        proto.has_range()     ? ".range"
        : proto.has_opacity() ? ".opacity"
                              : ".color_map",
        " is set beside ", path, ".quantity 4 (normal), which has no map: must be unset"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(color_by.map,
                            ColorMapFromProto(proto.color_map(), absl::StrCat(path, ".color_map")));
  if (proto.has_opacity()) {
    const isoscope::v1::MapOpacity& opacity = proto.opacity();
    ISOSCOPE_RETURN_IF_ERROR(
        CheckRange(opacity.at_min(), 0, 1, absl::StrCat(path, ".opacity.at_min")));
    ISOSCOPE_RETURN_IF_ERROR(
        CheckRange(opacity.at_max(), 0, 1, absl::StrCat(path, ".opacity.at_max")));
    color_by.opacity_at_min = opacity.at_min();
    color_by.opacity_at_max = opacity.at_max();
  }
  if (proto.has_range()) {
    ISOSCOPE_ASSIGN_OR_RETURN(color_by.range,
                              ColorRangeFromProto(proto.range(), absl::StrCat(path, ".range")));
  }
  return color_by;
}

absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  frame::FrameSpec spec;
  ISOSCOPE_ASSIGN_OR_RETURN(spec.surfaces, SurfacesFromProto(request));
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
  if (!isoscope::v1::CameraFit_IsValid(request.camera_fit())) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera_fit is ", static_cast<int>(request.camera_fit()),
                     ": must be CAMERA_FIT_VOLUME (1) or CAMERA_FIT_SURFACE (2)"));
  }
  if (request.has_background_color()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec.background_color,
                              ColorFromProto(request.background_color(), "background_color"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.clip, ClipRegionFromProto(request.clip(), "clip"));
  if (request.has_caps()) {
    if (spec.clip.half_spaces.empty() && !spec.clip.box.has_value()) {
      return absl::InvalidArgumentError(
          "caps is set without clip: must be unset, because there is no cut to fill; give "
          "clip.half_spaces or clip.box");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(spec.caps, ClipCapsFromProto(request.caps(), "caps"));
  }
  if (request.max_layers() < 0 || request.max_layers() > frame::kMaxLayers) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_layers is ", request.max_layers(), ": must lie in [1, ",
                     frame::kMaxLayers, "], or be 0 for the default, ", frame::kDefaultLayers));
  }
  spec.max_layers = request.max_layers() == 0 ? frame::kDefaultLayers : request.max_layers();
  ISOSCOPE_ASSIGN_OR_RETURN(spec.lights, LightsFromProto(request));
  spec.ray_seed = static_cast<std::uint64_t>(request.ray_seed());
  ISOSCOPE_ASSIGN_OR_RETURN(spec.output, OutputFromProto(request.output(), "output"));
  ISOSCOPE_ASSIGN_OR_RETURN(spec.effects, EffectsFromProto(request));
  ISOSCOPE_RETURN_IF_ERROR(frame::CheckDrawnWindow(spec));
  if (spec.output.image_format == frame::ImageFormat::kJpeg && spec.background_color.a != 255) {
    return absl::InvalidArgumentError(
        absl::StrCat("background_color.alpha is ", request.background_color().alpha(),
                     ": must be 1 with output.image_format JPEG, which has no transparency"));
  }
  return spec;
}

absl::StatusOr<view::ClipRegion> ClipRegionFromProto(const isoscope::v1::ClipRegion& proto,
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

absl::StatusOr<ExportSpec> ExportSpecFromProto(
    const isoscope::v1::ExportIsosurfaceRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  isoscope::v1::RenderIsosurfaceRequest frame;
  frame.set_isovalue(request.isovalue());
  *frame.mutable_surfaces() = request.surfaces();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<frame::Surface> surfaces, SurfacesFromProto(frame));
  ExportSpec spec;
  for (const frame::Surface& surface : surfaces) {
    spec.isovalues.push_back(surface.isovalue);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec.clip, ClipRegionFromProto(request.clip(), "clip"));
  return spec;
}

isoscope::v1::ColorBy ToProto(const frame::ColorBy& color_by) {
  using Proto = isoscope::v1::ColorBy;
  Proto proto;
  switch (color_by.quantity) {
    case frame::ColorBy::Quantity::kPositionX:
      proto.set_quantity(Proto::QUANTITY_POSITION_X);
      break;
    case frame::ColorBy::Quantity::kPositionY:
      proto.set_quantity(Proto::QUANTITY_POSITION_Y);
      break;
    case frame::ColorBy::Quantity::kPositionZ:
      proto.set_quantity(Proto::QUANTITY_POSITION_Z);
      break;
    case frame::ColorBy::Quantity::kNormal:
      proto.set_quantity(Proto::QUANTITY_NORMAL);
      return proto;
    case frame::ColorBy::Quantity::kGradientMagnitude:
      proto.set_quantity(Proto::QUANTITY_GRADIENT_MAGNITUDE);
      break;
  }
  // The same order, after the unspecified one.
  proto.set_color_map(static_cast<isoscope::v1::ColorMap>(static_cast<int>(color_by.map) + 1));
  if (color_by.range.has_value()) {
    proto.mutable_range()->set_min(color_by.range->min);
    proto.mutable_range()->set_max(color_by.range->max);
  }
  if (color_by.is_translucent()) {
    proto.mutable_opacity()->set_at_min(color_by.opacity_at_min);
    proto.mutable_opacity()->set_at_max(color_by.opacity_at_max);
  }
  return proto;
}

isoscope::v1::ClipCaps ToProto(const frame::ClipCaps& caps) {
  isoscope::v1::ClipCaps proto;
  if (caps.map.has_value()) {
    proto.set_color_map(static_cast<isoscope::v1::ColorMap>(static_cast<int>(*caps.map) + 1));
  }
  if (caps.range.has_value()) {
    proto.mutable_range()->set_min(caps.range->min);
    proto.mutable_range()->set_max(caps.range->max);
  }
  return proto;
}

isoscope::v1::Light ToProto(const frame::Light& light) {
  isoscope::v1::Light proto;
  *proto.mutable_direction() = ToProto(light.direction);
  proto.set_space(light.space == frame::Light::Space::kView ? isoscope::v1::Light::SPACE_VIEW
                                                            : isoscope::v1::Light::SPACE_WORLD);
  proto.set_intensity(light.intensity);
  *proto.mutable_color() = ToProto(light.color);
  return proto;
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

absl::Status ResolveColorRanges(const isoscope::v1::Dataset& dataset,
                                isoscope::v1::RenderIsosurfaceRequest* request,
                                frame::FrameSpec* spec) {
  for (std::size_t i = 0; i < spec->surfaces.size(); ++i) {
    frame::Surface& surface = spec->surfaces[i];
    if (!surface.shows_gradient() || surface.color_by->range.has_value()) {
      continue;
    }
    const std::string path = absl::StrCat("surfaces[", i, "].color_by.range");
    if (!dataset.has_max_gradient_magnitude()) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, " is not set: required, because dataset '", dataset.name(),
          "' was partitioned by a version that did not store max_gradient_magnitude; give the "
          "range (--color-by gradient:MAP:MIN,MAX), or partition the volume anew"));
    }
    // A field that is constant has no surface; its map still needs a range.
    const double max = dataset.max_gradient_magnitude();
    surface.color_by->range = frame::ColorRange{.min = 0, .max = max > 0 ? max : 1};
    *request->mutable_surfaces(static_cast<int>(i))->mutable_color_by() =
        ToProto(*surface.color_by);
  }
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
