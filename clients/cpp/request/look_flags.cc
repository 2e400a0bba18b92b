// Each flag has a parser, a writer into the request, and a help text:
//
//   --light      X,Y,Z[:INTENSITY[:R,G,B]]                       up to four, in one space
//   --color-by   QUANTITY[:MAP[:MIN,MAX[:OPACITY,OPACITY]]]      for all surfaces, or for each
//   --material   glossy or soft                                  of all surfaces
//   --nan-color  COLOR                                           needs a map over samples
//   --caps       "" or MAP[:MIN,MAX]                             needs a clip region
//   --cap-window LOW,HIGH or none                                needs --caps MAP
//   --color-range visible|step|all                               needs a map without MIN,MAX
//
// Parsers check one value; CheckUsage checks the flags against each other and the surfaces.

#include "clients/cpp/request/look_flags.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "google/protobuf/descriptor.h"

#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "wire/first_look.h"
#include "wire/frame_convert.h"
#include "wire/surface_convert.h"

namespace isoscope::client {
namespace {

using frame::ColorBy;
using frame::ColorMap;
using frame::Light;

// Each name is that of the proto: COLOR_MAP_COOL_WARM is "cool-warm". The first map is the default.
const std::vector<std::pair<std::string, ColorMap>>& ColorMapNames() {
  static const auto names = [] {
    std::vector<std::pair<std::string, ColorMap>> all;
    const google::protobuf::EnumDescriptor& maps = *isoscope::v1::ColorMap_descriptor();
    for (int i = 1; i < maps.value_count(); ++i) {
      isoscope::v1::ClipCaps caps;
      caps.set_color_map(static_cast<isoscope::v1::ColorMap>(maps.value(i)->number()));
      const absl::StatusOr<frame::ClipCaps> known = wire::ClipCapsFromProto(caps, "caps");
      if (known.ok()) {
        const absl::string_view name = absl::StripPrefix(maps.value(i)->name(), "COLOR_MAP_");
        all.emplace_back(absl::StrReplaceAll(absl::AsciiStrToLower(name), {{"_", "-"}}),
                         *known->map);
      }
    }
    return all;
  }();
  return names;
}

std::string ListOfColorMaps() {
  std::string list;
  for (const auto& [name, map] : ColorMapNames()) {
    absl::StrAppend(&list, list.empty() ? "" : ", ", name, list.empty() ? " (default)" : "");
  }
  return list;
}

using Quantity = std::optional<ColorBy::Quantity>;

const std::vector<std::pair<std::string, Quantity>>& QuantityNames() {
  static const std::vector<std::pair<std::string, Quantity>> names = {
      {"x", ColorBy::Quantity::kPositionX},
      {"y", ColorBy::Quantity::kPositionY},
      {"z", ColorBy::Quantity::kPositionZ},
      {"normal", ColorBy::Quantity::kNormal},
      {"gradient", ColorBy::Quantity::kGradientMagnitude},
      {"none", std::nullopt}};
  return names;
}

absl::Status NoQuantity(absl::string_view text) {
  return ParseChoice<Quantity>(text, QuantityNames()).status();
}

absl::StatusOr<Light::Space> ParseSpace(absl::string_view text) {
  return ParseChoice<Light::Space>(
      text, {{"view", Light::Space::kView}, {"world", Light::Space::kWorld}});
}

absl::StatusOr<MaterialChoice> ParseMaterial(absl::string_view text) {
  return ParseChoice<MaterialChoice>(
      text, {{"glossy", MaterialChoice::kGlossy}, {"soft", MaterialChoice::kSoft}});
}

absl::StatusOr<std::pair<float, float>> ParseOpacities(absl::string_view text) {
  const std::vector<absl::string_view> ends = absl::StrSplit(text, ',');
  const absl::Status malformed = absl::InvalidArgumentError(
      absl::StrCat(base::Quoted(text, '\''),
                   " is not OPACITY,OPACITY, those at the least and at the greatest value, two "
                   "numbers from 0 to 1 between a comma"));
  if (ends.size() != 2) {
    return malformed;
  }
  const absl::StatusOr<double> at_min = ParseNumber(ends[0]);
  const absl::StatusOr<double> at_max = ParseNumber(ends[1]);
  if (!at_min.ok() || !at_max.ok() || !(*at_min >= 0 && *at_min <= 1) ||
      !(*at_max >= 0 && *at_max <= 1)) {
    return malformed;
  }
  return std::pair(static_cast<float>(*at_min), static_cast<float>(*at_max));
}

absl::StatusOr<frame::ColorRange> ParseColorRange(absl::string_view text) {
  const std::vector<absl::string_view> ends = absl::StrSplit(text, ',');
  const absl::Status malformed = absl::InvalidArgumentError(absl::StrCat(
      base::Quoted(text, '\''), " is not MIN,MAX, two numbers between a comma with MIN < MAX"));
  if (ends.size() != 2) {
    return malformed;
  }
  const absl::StatusOr<double> min = ParseNumber(ends[0]);
  const absl::StatusOr<double> max = ParseNumber(ends[1]);
  if (!min.ok() || !max.ok() || !(*min < *max) || !std::isfinite(*max - *min)) {
    return malformed;
  }
  return frame::ColorRange{.min = *min, .max = *max};
}

absl::StatusOr<frame::RangeSource> ParseRangeSource(absl::string_view text) {
  return ParseChoice<frame::RangeSource>(text, {{"visible", frame::RangeSource::kVisible},
                                                {"step", frame::RangeSource::kStep},
                                                {"all", frame::RangeSource::kAllSteps}});
}

bool HasMap(const ColorBy& color_by) { return color_by.quantity != ColorBy::Quantity::kNormal; }

// Whether caps show samples through a map that has no range yet.
bool HasOpenCaps(const isoscope::v1::RenderIsosurfaceRequest& request) {
  return request.has_caps() && request.caps().color_map() != isoscope::v1::COLOR_MAP_UNSPECIFIED &&
         !request.caps().has_range();
}

void SetCaps(frame::ClipCaps caps, isoscope::v1::RenderIsosurfaceRequest* request) {
  const isoscope::v1::ColorMap map = request->caps().color_map();
  *request->mutable_caps() = wire::ToProto(caps);
  request->mutable_caps()->set_color_map(map);
}

// Adds --cap-window, or else --color-range.
void AddRangeOfCaps(const LookFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request) {
  if (!HasOpenCaps(*request)) {
    return;
  }
  frame::ClipCaps caps;
  if (flags.cap_window) {
    caps.percentiles = flags.cap_window->percentiles;
  } else if (flags.color_range) {
    caps.range_source = *flags.color_range;
  }
  SetCaps(caps, request);
}

// Whether the numbers of a range are those of one picture.
bool IsOfPicture(const isoscope::v1::ColorRange& range) {
  return range.has_percentiles() || range.source() == isoscope::v1::ColorRange::SOURCE_VISIBLE;
}

// How many of the words between colons are those of a field and its component: up to the last map
// that can be one, because a range and opacities at most follow a map; else all.
std::size_t WordsOfName(const std::vector<absl::string_view>& words) {
  constexpr std::size_t kMostBehindMap = 2;
  for (std::size_t i = words.size() - 1; i > 0 && words.size() - 1 - i <= kMostBehindMap; --i) {
    if (ParseChoice<ColorMap>(words[i], ColorMapNames()).ok()) {
      return i;
    }
  }
  return words.size();
}

}  // namespace

std::string NameOf(ColorMap map) {
  for (const auto& [name, value] : ColorMapNames()) {
    if (value == map) {
      return name;
    }
  }
  return "";
}

absl::StatusOr<Light> ParseLight(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  if (parts.size() > 3) {
    return absl::InvalidArgumentError(
        absl::StrCat(base::Quoted(text, '\''), " is not X,Y,Z[:INTENSITY[:COLOR]]"));
  }
  Light light;
  ISOSCOPE_ASSIGN_OR_RETURN(light.direction, ParseVector(parts[0]));
  const double length = math::Length(light.direction);
  if (!(length > 0) || !std::isfinite(length)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", parts[0], "' has no direction: its length must be neither 0 nor infinite"));
  }
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(const double intensity, ParseNumber(parts[1]));
    if (!(intensity >= 0 && intensity <= static_cast<double>(frame::kMaxLightIntensity))) {
      return absl::InvalidArgumentError(absl::StrCat(
          base::Quoted(parts[1], '\''), " is no intensity from 0 to ", frame::kMaxLightIntensity));
    }
    light.intensity = static_cast<float>(intensity);
  }
  if (parts.size() > 2) {
    ISOSCOPE_ASSIGN_OR_RETURN(const frame::Color color, ParseColor(parts[2]));
    const auto channel = [](float value) {
      return static_cast<std::uint8_t>(std::lround(static_cast<double>(value) * 255));
    };
    light.color = {channel(color.red), channel(color.green), channel(color.blue), 255};
  }
  return light;
}

absl::StatusOr<ColorByValue> ParseColorBy(absl::string_view text) {
  std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  const auto known = std::find_if(QuantityNames().begin(), QuantityNames().end(),
                                  [&](const auto& name) { return name.first == parts[0]; });
  ColorByValue value;
  bool has_map = true;
  if (known != QuantityNames().end()) {
    if (known->second) {
      value.color_by = ColorBy{.quantity = *known->second};
    }
    has_map = known->second && *known->second != ColorBy::Quantity::kNormal;
  } else if (parts[0].empty()) {
    return NoQuantity(text);
  } else {
    if (parts.back().empty() && parts.size() == 2) {
      return absl::InvalidArgumentError(absl::StrCat(
          base::Quoted(text, '\''), " has no component or colour map after its first colon"));
    }
    // The name ends before the last word that is a map, or with the text.
    const std::size_t words = WordsOfName(parts);
    value.field =
        absl::StrJoin(parts.begin(), parts.begin() + static_cast<std::ptrdiff_t>(words), ":");
    parts.erase(parts.begin() + 1, parts.begin() + static_cast<std::ptrdiff_t>(words));
    value.color_by.emplace();
  }
  if (parts.size() > (has_map ? 4U : 1U)) {
    const absl::string_view what =
        value.field.empty() ? "x|y|z|gradient" : absl::string_view("FIELD[:COMPONENT]");
    return absl::InvalidArgumentError(
        absl::StrCat(base::Quoted(text, '\''), " is not ",
                     has_map ? absl::StrCat(what, "[:MAP[:MIN,MAX[:OPACITY,OPACITY]]]")
                             : "normal or none alone"));
  }
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(value.color_by->map,
                              ParseChoice<ColorMap>(parts[1], ColorMapNames()));
  }
  if (parts.size() > 2 && !(parts.size() > 3 && parts[2].empty())) {
    ISOSCOPE_ASSIGN_OR_RETURN(value.color_by->range, ParseColorRange(parts[2]));
  }
  if (parts.size() > 3) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::tie(value.color_by->opacity_at_min, value.color_by->opacity_at_max),
        ParseOpacities(parts[3]));
  }
  return value;
}

absl::StatusOr<frame::ClipCaps> ParseCaps(absl::string_view text) {
  frame::ClipCaps caps;
  if (text.empty()) {
    return caps;
  }
  const std::vector<absl::string_view> parts = absl::StrSplit(text, absl::MaxSplits(':', 1));
  ISOSCOPE_ASSIGN_OR_RETURN(caps.map, ParseChoice<ColorMap>(parts[0], ColorMapNames()));
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(caps.range, ParseColorRange(parts[1]));
  }
  return caps;
}

absl::StatusOr<CapWindow> ParseCapWindow(absl::string_view text) {
  if (text == "none") {
    return CapWindow();
  }
  const std::vector<absl::string_view> ends = absl::StrSplit(text, ',');
  if (ends.size() == 2) {
    const absl::StatusOr<double> low = ParseNumber(ends[0]);
    const absl::StatusOr<double> high = ParseNumber(ends[1]);
    if (low.ok() && high.ok() && *low >= 0 && *low < *high && *high <= 100) {
      return CapWindow{.percentiles = frame::Percentiles{.low = *low, .high = *high}};
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      base::Quoted(text, '\''),
      " is not LOW,HIGH, two percentages from 0 to 100 between a comma with LOW < HIGH, "
      "or none"));
}

void AddLookFlags(cli::FlagSet* set, LookFlags* flags) {
  const std::string group = "Lights and colours";
  cli::AddRepeatableFlag(set, "--light", "X,Y,Z[:INTENSITY[:COLOR]]", &flags->lights, ParseLight,
                         "a light from this direction, in place of the head light; up to 4 times; "
                         "intensity 0 to 10 (default: 1)")
      .Group(group);
  cli::AddFlag(set, "--light-space", "view|world", &flags->light_space, ParseSpace,
               "the space of all lights: view (default; x right, y up, z to the eye) or world")
      .Group(group);
  cli::AddFlag(set, "--material", "glossy|soft", &flags->material, ParseMaterial,
               "how surfaces reflect the light: glossy, with a white highlight where they face the "
               "eye (the default if a flag of the camera is given), or soft, which keeps colours")
      .Group(group);
  cli::AddRepeatableFlag(
      set, "--color-by",
      "x|y|z|gradient|normal|none|FIELD[:COMPONENT][:MAP[:MIN,MAX[:OPACITY,OPACITY]]]",
      &flags->color_by, ParseColorBy,
      "colour surfaces by a world coordinate, by the length of the gradient, by their normal or by "
      "another field of the dataset; once for all of them, or once for each --surface; maps: " +
          ListOfColorMaps() +
          "; the range is the volume's box by default, of the gradient 0 to its bound (isoscope "
          "info), of a field its range over all steps, as if it were left empty (z:grey::0.2,1); "
          "opacities are those at MIN and MAX, and below 1 the surface is translucent")
      .Group(group);
  cli::AddFlag(
      set, "--color-range", "visible|step|all", &flags->color_range, ParseRangeSource,
      "range of the maps of --color-by, and of --caps without --cap-window, that have no "
      "MIN,MAX: the values that the picture shows, those of its time step, or those of all "
      "steps (default); in a film, visible is that of the first frame")
      .Group(group);
  cli::AddFlag(set, "--cap-window", "LOW,HIGH|none", &flags->cap_window, ParseCapWindow,
               "window of the samples on the cuts of --caps MAP: from one percentile to another of "
               "the samples from the lowest isovalue of an opaque surface on (render: 2,98 by "
               "default), or none: the range of all samples")
      .Group(group);
  cli::AddFlag(set, "--nan-color", "COLOR", &flags->nan_color, ParseColor,
               "colour where the field of --color-by, or the samples of --caps MAP, are missing "
               "(NaN), as of --color (default: grey, 0.5; purple with the maps grey and cividis, "
               "which have that grey)")
      .Group(group);
}

absl::Status CheckUsage(const LookFlags& flags, std::size_t surface_count, bool has_sample_caps) {
  if (flags.lights.size() > frame::kMaxLights) {
    return cli::UsageError(absl::StrCat("--light is given ", flags.lights.size(),
                                        " times: at most ", frame::kMaxLights, " are allowed"));
  }
  if (flags.light_space && flags.lights.empty()) {
    return cli::UsageError("--light-space is the space of --light: give at least one light");
  }
  if (flags.color_by.size() > 1 && flags.color_by.size() != surface_count) {
    return cli::UsageError(
        absl::StrCat("--color-by is given ", flags.color_by.size(), " times, with ", surface_count,
                     " surfaces: give it once for all, or once for each in their "
                     "order (none keeps the colour)"));
  }
  const bool shows_field =
      std::any_of(flags.color_by.begin(), flags.color_by.end(),
                  [](const ColorByValue& value) { return !value.field.empty(); });
  const bool has_map = std::any_of(
      flags.color_by.begin(), flags.color_by.end(),
      [](const ColorByValue& value) { return value.color_by && HasMap(*value.color_by); });
  if (flags.color_range && !has_map && !has_sample_caps) {
    return cli::UsageError(
        "--color-range is the range of colour maps: give --color-by with a map, or --caps with "
        "one");
  }
  if (flags.cap_window && !has_sample_caps) {
    return cli::UsageError(
        "--cap-window is that of the samples on cuts: give --caps with a map, as --caps grey");
  }
  if (flags.nan_color && !shows_field && !has_sample_caps) {
    return cli::UsageError(
        "--nan-color is the colour of missing samples: give --color-by with a field, or --caps "
        "with a map");
  }
  return absl::OkStatus();
}

absl::Status CheckColorFields(const LookFlags& flags, const isoscope::v1::Dataset& dataset) {
  for (const ColorByValue& value : flags.color_by) {
    if (!value.field.empty() && dataset.fields().empty()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "--color-by ", NoQuantity(value.field).message(), "; the dataset has no other fields"));
    }
  }
  return absl::OkStatus();
}

void AddLook(const LookFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request) {
  for (Light light : flags.lights) {
    light.space = flags.light_space.value_or(Light::Space::kView);
    *request->add_lights() = wire::ToProto(light);
  }
  if (flags.nan_color) {
    *request->mutable_nan_color() = ToProto(*flags.nan_color);
  }
  AddRangeOfCaps(flags, request);
  if (flags.material == MaterialChoice::kSoft) {
    PromoteIsovalue(request);
    wire::AddFirstMaterial(request);
  }
  if (flags.color_by.empty()) {
    return;
  }
  PromoteIsovalue(request);
  for (int i = 0; i < request->surfaces_size(); ++i) {
    const ColorByValue& value =
        flags.color_by[flags.color_by.size() == 1 ? 0 : static_cast<std::size_t>(i)];
    if (!value.color_by) {
      continue;
    }
    isoscope::v1::ColorBy* const proto = request->mutable_surfaces(i)->mutable_color_by();
    ColorBy color_by = *value.color_by;
    color_by.range_source = flags.color_range.value_or(frame::RangeSource::kAllSteps);
    *proto = wire::ToProto(color_by);
    if (!value.field.empty()) {
      proto->set_quantity(isoscope::v1::ColorBy::QUANTITY_FIELD);
      proto->set_field(value.field);
      proto->set_component(value.component);
    }
  }
}

void AddCommonCapWindow(const LookFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request) {
  if (!flags.cap_window && !flags.color_range && HasOpenCaps(*request)) {
    SetCaps({.percentiles = frame::Percentiles()}, request);
  }
}

bool HasVisibleRange(const isoscope::v1::RenderIsosurfaceRequest& request) {
  const auto is_visible = [](const isoscope::v1::ColorRange& range) {
    return range.source() == isoscope::v1::ColorRange::SOURCE_VISIBLE;
  };
  return is_visible(request.caps().range()) ||
         std::any_of(request.surfaces().begin(), request.surfaces().end(),
                     [&](const isoscope::v1::Surface& surface) {
                       return is_visible(surface.color_by().range());
                     });
}

void KeepRanges(const isoscope::v1::RenderIsosurfaceResponse& answer,
                isoscope::v1::RenderIsosurfaceRequest* request) {
  if (IsOfPicture(request->caps().range()) && answer.caps_coloring().caps().has_range()) {
    *request->mutable_caps()->mutable_range() = answer.caps_coloring().caps().range();
  }
  for (const isoscope::v1::SurfaceColoring& coloring : answer.colorings()) {
    const int i = coloring.surface_index();
    if (i >= 0 && i < request->surfaces_size() && coloring.color_by().has_range() &&
        IsOfPicture(request->surfaces(i).color_by().range())) {
      *request->mutable_surfaces(i)->mutable_color_by()->mutable_range() =
          coloring.color_by().range();
    }
  }
}

}  // namespace isoscope::client
