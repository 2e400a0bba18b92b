// The parts of a surface, in the order of a request: colour and opacity, material, the colour by a
// quantity, caps, lights. A request has a list of surfaces, or one surface by its fields isovalue
// and base_color, never both.
//
// Numbers are checked with InRange or CheckFinite, which refuse NaN, and directions with
// CheckLength. A range of colours that the request leaves out is filled in later, because it depends
// on the dataset (color_range_convert.h).

#include "wire/surface_convert.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "wire/enum_table.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {

namespace v1 = isoscope::v1;

namespace {

using Quantity = frame::ColorBy::Quantity;

constexpr float kMaxShininess = 1000;

constexpr EnumRow<frame::ColorMap, v1::ColorMap> kColorMaps[] = {
    {frame::ColorMap::kViridis, v1::COLOR_MAP_VIRIDIS},
    {frame::ColorMap::kViridis, v1::COLOR_MAP_UNSPECIFIED},
    {frame::ColorMap::kMagma, v1::COLOR_MAP_MAGMA},
    {frame::ColorMap::kCividis, v1::COLOR_MAP_CIVIDIS},
    {frame::ColorMap::kTurbo, v1::COLOR_MAP_TURBO},
    {frame::ColorMap::kCoolWarm, v1::COLOR_MAP_COOL_WARM},
    {frame::ColorMap::kGrey, v1::COLOR_MAP_GREY}};
constexpr EnumRow<Quantity, v1::ColorBy::Quantity> kQuantities[] = {
    {Quantity::kPositionX, v1::ColorBy::QUANTITY_POSITION_X},
    {Quantity::kPositionY, v1::ColorBy::QUANTITY_POSITION_Y},
    {Quantity::kPositionZ, v1::ColorBy::QUANTITY_POSITION_Z},
    {Quantity::kNormal, v1::ColorBy::QUANTITY_NORMAL},
    {Quantity::kGradientMagnitude, v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE},
    {Quantity::kField, v1::ColorBy::QUANTITY_FIELD}};
constexpr EnumRow<frame::Light::Space, v1::Light::Space> kSpaces[] = {
    {frame::Light::Space::kView, v1::Light::SPACE_VIEW},
    {frame::Light::Space::kView, v1::Light::SPACE_UNSPECIFIED},
    {frame::Light::Space::kWorld, v1::Light::SPACE_WORLD}};

absl::Status SetColor(const v1::Color& proto, absl::string_view path, frame::Surface* surface) {
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

absl::Status SetMaterial(const v1::Material& proto, const std::string& path,
                         frame::Appearance* appearance) {
  const auto read = [&](bool is_set, float value, float min, float max, const char* name,
                        auto* to) -> absl::Status {
    if (is_set) {
      ISOSCOPE_ASSIGN_OR_RETURN(*to, InRange(value, min, max, absl::StrCat(path, name)));
    }
    return absl::OkStatus();
  };
  ISOSCOPE_RETURN_IF_ERROR(
      read(proto.has_ambient(), proto.ambient(), 0, 1, ".ambient", &appearance->ambient));
  ISOSCOPE_RETURN_IF_ERROR(
      read(proto.has_diffuse(), proto.diffuse(), 0, 1, ".diffuse", &appearance->diffuse));
  ISOSCOPE_RETURN_IF_ERROR(
      read(proto.has_specular(), proto.specular(), 0, 1, ".specular", &appearance->specular));
  return read(proto.has_shininess(), proto.shininess(), 1, kMaxShininess, ".shininess",
              &appearance->shininess);
}

absl::StatusOr<frame::ColorMap> ColorMapFromProto(v1::ColorMap proto, const std::string& path) {
  return EnumFromProto(kColorMaps, proto, path,
                       "must be 0 or 1 (viridis), 2 (magma), 3 (cividis), 4 (turbo), 5 (cool-warm) "
                       "or 6 (grey)");
}

// The field of QUANTITY_FIELD, which no other quantity has.
absl::Status SetField(const v1::ColorBy& proto, absl::string_view path, frame::ColorBy* color_by) {
  if (color_by->quantity == Quantity::kField) {
    if (proto.field().empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ".field is not set: required with ", path, ".quantity 6 (field)"));
    }
    color_by->field = proto.field();
    color_by->component = proto.component();
    return absl::OkStatus();
  }
  if (!proto.field().empty() || !proto.component().empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, proto.field().empty() ? ".component" : ".field", " is ",
                     base::Quoted(proto.field().empty() ? proto.component() : proto.field()),
                     " beside ", path, ".quantity ", static_cast<int>(proto.quantity()),
                     ", which shows no other field: must be unset"));
  }
  return absl::OkStatus();
}

absl::StatusOr<frame::Light> LightFromProto(const v1::Light& proto, const std::string& path) {
  frame::Light light;
  const std::string direction_path = absl::StrCat(path, ".direction");
  ISOSCOPE_ASSIGN_OR_RETURN(light.direction, VectorFromProto(proto.direction(), direction_path));
  ISOSCOPE_RETURN_IF_ERROR(CheckLength(light.direction, direction_path));
  ISOSCOPE_ASSIGN_OR_RETURN(light.space,
                            EnumFromProto(kSpaces, proto.space(), absl::StrCat(path, ".space"),
                                          "must be 0 (view), 1 (view) or 2 (world)"));
  if (proto.has_intensity()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        light.intensity,
        InRange(proto.intensity(), 0, frame::kMaxLightIntensity, absl::StrCat(path, ".intensity")));
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

absl::StatusOr<frame::Surface> SurfaceFromProto(const v1::Surface& proto, const std::string& path) {
  frame::Surface surface;
  ISOSCOPE_ASSIGN_OR_RETURN(
      surface.rule, InsideRuleFromProto(proto.isovalue(), proto.labels(), proto.smooth_labels(),
                                        absl::StrCat(path, ".")));
  if (proto.has_color()) {
    ISOSCOPE_RETURN_IF_ERROR(SetColor(proto.color(), absl::StrCat(path, ".color"), &surface));
  }
  ISOSCOPE_RETURN_IF_ERROR(
      SetMaterial(proto.material(), absl::StrCat(path, ".material"), &surface.appearance));
  if (proto.has_color_by()) {
    ISOSCOPE_ASSIGN_OR_RETURN(surface.color_by,
                              ColorByFromProto(proto.color_by(), absl::StrCat(path, ".color_by")));
  }
  if (surface.rule.has_labels() && surface.shows_gradient()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ".color_by.quantity is 5 (gradient magnitude) beside ", path,
        ".labels: must be another one, because the size of a step between labels means "
        "nothing"));
  }
  return surface;
}

// The surface of a request that lists none.
absl::StatusOr<frame::Surface> OnlySurfaceFromProto(const v1::RenderIsosurfaceRequest& request) {
  frame::Surface surface;
  ISOSCOPE_ASSIGN_OR_RETURN(surface.rule,
                            InsideRuleFromProto(request.isovalue(), {}, /*smooths=*/false, ""));
  if (request.has_base_color()) {
    ISOSCOPE_RETURN_IF_ERROR(SetColor(request.base_color(), "base_color", &surface));
  }
  return surface;
}

}  // namespace

absl::StatusOr<float> InRange(float value, float min, float max, absl::string_view path) {
  if (value >= min && value <= max) {
    return value;
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

absl::StatusOr<volume::InsideRule> LabelsFromProto(
    const google::protobuf::RepeatedField<double>& labels, bool smooths, const std::string& path) {
  for (int i = 0; i < labels.size(); ++i) {
    ISOSCOPE_RETURN_IF_ERROR(CheckFinite(labels[i], absl::StrCat(path, "[", i, "]")));
  }
  std::vector<double> values(labels.begin(), labels.end());
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  if (values.empty() || values.size() > volume::kMaxLabels) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, " has ", values.size(), " different values: must have 1 to ", volume::kMaxLabels));
  }
  return volume::InsideRule::OfLabels(std::move(values), smooths);
}

absl::StatusOr<volume::InsideRule> InsideRuleFromProto(
    double isovalue, const google::protobuf::RepeatedField<double>& labels, bool smooths,
    const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(isovalue, absl::StrCat(path, "isovalue")));
  if (labels.empty()) {
    if (smooths) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, "smooth_labels is set without ", path,
                       "labels: must be unset, because an isosurface has no steps to smooth"));
    }
    return volume::InsideRule::OfIsovalue(isovalue);
  }
  if (isovalue != 0) {
    return absl::InvalidArgumentError(absl::StrCat(path, "isovalue is ", isovalue, " beside ", path,
                                                   "labels: must be unset, because a surface has "
                                                   "one or the other"));
  }
  return LabelsFromProto(labels, smooths, absl::StrCat(path, "labels"));
}

absl::StatusOr<frame::ColorBy> ColorByFromProto(const v1::ColorBy& proto, absl::string_view path) {
  frame::ColorBy color_by;
  ISOSCOPE_ASSIGN_OR_RETURN(
      color_by.quantity,
      EnumFromProto(kQuantities, proto.quantity(), absl::StrCat(path, ".quantity"),
                    "must be 1 (position x), 2 (position y), 3 (position z), "
                    "4 (normal), 5 (gradient magnitude) or 6 (field)"));
  ISOSCOPE_RETURN_IF_ERROR(SetField(proto, path, &color_by));
  if (color_by.quantity == frame::ColorBy::Quantity::kNormal &&
      (proto.color_map() != v1::COLOR_MAP_UNSPECIFIED || proto.has_range() ||
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
    const v1::MapOpacity& opacity = proto.opacity();
    ISOSCOPE_ASSIGN_OR_RETURN(
        color_by.opacity_at_min,
        InRange(opacity.at_min(), 0, 1, absl::StrCat(path, ".opacity.at_min")));
    ISOSCOPE_ASSIGN_OR_RETURN(
        color_by.opacity_at_max,
        InRange(opacity.at_max(), 0, 1, absl::StrCat(path, ".opacity.at_max")));
  }
  if (proto.has_range()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const AskedRange asked,
                              AskedRangeFromProto(proto.range(), absl::StrCat(path, ".range")));
    if (asked.percentiles.has_value()) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, ".range.percentiles is set: must be unset, only caps have percentiles"));
    }
    color_by.range = asked.range;
    color_by.range_source = asked.source;
  }
  return color_by;
}

absl::StatusOr<frame::ClipCaps> ClipCapsFromProto(const v1::ClipCaps& proto,
                                                  const std::string& path) {
  frame::ClipCaps caps;
  if (proto.color_map() == v1::COLOR_MAP_UNSPECIFIED) {
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
    ISOSCOPE_ASSIGN_OR_RETURN(const AskedRange asked,
                              AskedRangeFromProto(proto.range(), absl::StrCat(path, ".range")));
    caps.range = asked.range;
    caps.range_source = asked.source;
    caps.percentiles = asked.percentiles;
  }
  return caps;
}

absl::StatusOr<std::vector<frame::Light>> LightsFromProto(
    const google::protobuf::RepeatedPtrField<v1::Light>& proto) {
  if (static_cast<std::size_t>(proto.size()) > frame::kMaxLights) {
    return absl::InvalidArgumentError(absl::StrCat(
        "lights has ", proto.size(), " elements: must have at most ", frame::kMaxLights));
  }
  std::vector<frame::Light> lights;
  for (int i = 0; i < proto.size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(lights.emplace_back(),
                              LightFromProto(proto[i], absl::StrCat("lights[", i, "]")));
  }
  return lights;
}

absl::StatusOr<std::vector<frame::Surface>> SurfacesFromProto(
    const v1::RenderIsosurfaceRequest& request, std::size_t max_surfaces) {
  if (request.surfaces().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(frame::Surface only, OnlySurfaceFromProto(request));
    return std::vector<frame::Surface>{std::move(only)};
  }
  if (request.isovalue() != 0 || request.has_base_color()) {
    return absl::InvalidArgumentError(
        absl::StrCat(request.has_base_color() ? "base_color" : "isovalue",
                     " is set beside surfaces: must be unset, because each surface has its own"));
  }
  return SurfacesFromProto(request.surfaces(), max_surfaces);
}

absl::StatusOr<std::vector<frame::Surface>> SurfacesFromProto(
    const google::protobuf::RepeatedPtrField<v1::Surface>& proto, std::size_t max_surfaces) {
  if (proto.empty()) {
    return absl::InvalidArgumentError("surfaces is empty: must have at least one element");
  }
  if (static_cast<std::size_t>(proto.size()) > max_surfaces) {
    return absl::InvalidArgumentError(
        absl::StrCat("surfaces has ", proto.size(), " elements: must have at most ", max_surfaces));
  }
  std::vector<frame::Surface> surfaces;
  for (int i = 0; i < proto.size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(surfaces.emplace_back(),
                              SurfaceFromProto(proto[i], absl::StrCat("surfaces[", i, "]")));
  }
  return surfaces;
}

v1::Surface ToProto(const frame::Surface& surface) {
  v1::Surface proto;
  proto.set_isovalue(surface.rule.isovalue);
  proto.mutable_labels()->Assign(surface.rule.labels.begin(), surface.rule.labels.end());
  proto.set_smooth_labels(surface.rule.smooths);
  const frame::Appearance& appearance = surface.appearance;
  *proto.mutable_color() = ToProto(appearance.base_color);
  proto.mutable_color()->set_alpha(surface.opacity);
  v1::Material& material = *proto.mutable_material();
  material.set_ambient(appearance.ambient);
  if (appearance.diffuse.has_value()) {
    material.set_diffuse(*appearance.diffuse);
  }
  material.set_specular(appearance.specular);
  material.set_shininess(appearance.shininess);
  if (surface.color_by.has_value()) {
    *proto.mutable_color_by() = ToProto(*surface.color_by);
  }
  return proto;
}

v1::ColorBy ToProto(const frame::ColorBy& color_by) {
  v1::ColorBy proto;
  proto.set_quantity(EnumToProto(kQuantities, color_by.quantity));
  if (color_by.quantity == Quantity::kNormal) {
    return proto;
  }
  proto.set_field(color_by.field);
  proto.set_component(color_by.component);
  proto.set_color_map(EnumToProto(kColorMaps, color_by.map));
  if (const auto range =
          ToProto(AskedRange{.range = color_by.range, .source = color_by.range_source});
      range.has_value()) {
    *proto.mutable_range() = *range;
  }
  if (color_by.is_translucent()) {
    proto.mutable_opacity()->set_at_min(color_by.opacity_at_min);
    proto.mutable_opacity()->set_at_max(color_by.opacity_at_max);
  }
  return proto;
}

v1::ClipCaps ToProto(const frame::ClipCaps& caps) {
  v1::ClipCaps proto;
  if (caps.map.has_value()) {
    proto.set_color_map(EnumToProto(kColorMaps, *caps.map));
  }
  if (const auto range = ToProto(AskedRange{
          .range = caps.range, .source = caps.range_source, .percentiles = caps.percentiles});
      range.has_value()) {
    *proto.mutable_range() = *range;
  }
  return proto;
}

v1::Light ToProto(const frame::Light& light) {
  v1::Light proto;
  *proto.mutable_direction() = ToProto(light.direction);
  proto.set_space(EnumToProto(kSpaces, light.space));
  proto.set_intensity(light.intensity);
  *proto.mutable_color() = ToProto(light.color);
  return proto;
}

absl::StatusOr<image::Rgba8> NanColorFromProto(const v1::Color& proto) {
  if (proto.alpha() != 1.0F) {
    return absl::InvalidArgumentError(
        absl::StrCat("nan_color.alpha is ", proto.alpha(),
                     ": must be 1, missing values have the opacity of the surface"));
  }
  return ColorFromProto(proto, "nan_color");
}

}  // namespace isoscope::wire
