// Source: OME-NGFF 0.4 and 0.5, https://ngff.openmicroscopy.org.
//
// In 0.4 the members stand in the attributes themselves, in 0.5 below "ome". Transformations come
// twice: those of a level, then those of all levels. Each list is one scale, and perhaps a
// translation behind it. So the place of element i along an axis is
//
//   S (s i + t) + T = (S s) i + (S t + T)

#include "core/formats/zarr/ome_image.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/source/grid/axis_order.h"
#include "core/source/grid/cf_words.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxOmeAxes = 5;
constexpr std::size_t kMaxOmeImages = 64;
constexpr std::size_t kMaxOmeLevels = 64;
constexpr std::size_t kMaxOmeChannels = 4096;

const ZarrJson& OmeMembersOf(const ZarrJson& attributes) {
  const ZarrJson* const ome = MemberOf(attributes, "ome");
  return ome != nullptr && ome->is_object() ? *ome : attributes;
}

absl::Status BadOme(const std::string& name, absl::string_view what, const ZarrJson* value,
                    absl::string_view expected) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: OME-Zarr: %s is %s; expected %s", name, what,
                      value == nullptr ? "missing" : ShownJson(*value), expected));
}

absl::Status CheckOmeVersion(const ZarrJson& members, const ZarrJson& image,
                             const std::string& name) {
  const ZarrJson* version = MemberOf(members, "version");
  version = version == nullptr ? MemberOf(image, "version") : version;
  const std::vector<std::string> known = {"0.1", "0.2", "0.3", "0.4", "0.5"};
  if (version == nullptr ||
      (version->is_string() && std::any_of(known.begin(), known.end(), [&](const std::string& v) {
         return version->get_ref<const std::string&>().substr(0, v.size()) == v;
       }))) {
    return absl::OkStatus();
  }
  return BadOme(name, "its version", version, "0.4 or 0.5");
}

// The kind of an axis: by its type where it has one, and its name.
char OmeLetterOf(absl::string_view axis_name, absl::string_view type) {
  if (type == "time") {
    return 'T';
  }
  if (type == "channel") {
    return 'C';
  }
  const char letter = AxisLetterOf(axis_name);
  const bool is_space = letter == 'X' || letter == 'Y' || letter == 'Z';
  return type == "space" && !is_space ? '?' : letter;
}

absl::StatusOr<std::vector<OmeAxis>> OmeAxesIn(const ZarrJson& image, const std::string& name) {
  const ZarrJson* const list = MemberOf(image, "axes");
  if (list == nullptr) {  // before 0.3
    return std::vector<OmeAxis>{
        {.letter = 'T'}, {.letter = 'C'}, {.letter = 'Z'}, {.letter = 'Y'}, {.letter = 'X'}};
  }
  if (!list->is_array() || list->empty() || list->size() > kMaxOmeAxes) {
    return BadOme(name, "its list of axes", list, "2 to 5 axes");
  }
  std::vector<OmeAxis> axes;
  std::set<char> letters;
  for (const ZarrJson& item : *list) {
    const std::string axis_name = item.is_string() ? item.get<std::string>() : TextOf(item, "name");
    const char letter = OmeLetterOf(axis_name, TextOf(item, "type"));
    if (letter == '?' || !letters.insert(letter).second) {
      return BadOme(name, "an axis", &item, "each of t, c, z, y and x once");
    }
    axes.push_back({.letter = letter, .unit = TextOf(item, "unit")});
  }
  return axes;
}

// Applies a list of transformations behind those that the level has.
absl::Status ApplyOmeTransformations(const ZarrJson* list, const std::string& name,
                                     OmeLevel* level) {
  if (list == nullptr || list->is_null()) {
    return absl::OkStatus();
  }
  if (!list->is_array() || list->size() > 8) {
    return BadOme(name, "coordinateTransformations", list, "a scale, and perhaps a translation");
  }
  const std::size_t rank = level->scale.size();
  for (const ZarrJson& item : *list) {
    const std::string type = TextOf(item, "type");
    if (type == "identity") {
      continue;
    }
    if (type != "scale" && type != "translation") {
      return BadOme(name, "a transformation", &item, "a scale or a translation");
    }
    const std::vector<double> numbers = NumbersOf(item, type.c_str());
    if (numbers.size() != rank) {
      return BadOme(name, "a transformation", &item, absl::StrCat(rank, " numbers"));
    }
    for (std::size_t axis = 0; axis < rank; ++axis) {
      if (type == "scale") {
        level->scale[axis] *= numbers[axis];
        level->translation[axis] *= numbers[axis];
      } else {
        level->translation[axis] += numbers[axis];
      }
    }
  }
  return absl::OkStatus();
}

// The world axis of a letter.
double& OmeComponent(math::Vec3d* v, char letter) {
  return letter == 'X' ? v->x : letter == 'Y' ? v->y : v->z;
}

// What turns lengths of each axis of space to the unit of all.
absl::StatusOr<std::array<double, 3>> OmeUnitFactors(const std::vector<OmeAxis>& axes,
                                                     const std::array<std::size_t, 3>& space,
                                                     const GridRules& rules, std::string* unit) {
  std::array<double, 3> factors{1, 1, 1};
  const std::string& first = axes[space[0]].unit;
  *unit = first;
  const bool is_one = std::all_of(space.begin(), space.end(),
                                  [&](std::size_t axis) { return axes[axis].unit == first; });
  if (is_one) {
    return factors;
  }
  *unit = "m";
  for (std::size_t i = 0; i < space.size(); ++i) {
    const OmeAxis& axis = axes[space[i]];
    factors[i] = MetresOfCfUnit(axis.unit);
    if (factors[i] == 0 && !rules.has_spacing) {
      return NoSampleDistance(
          "", absl::StrFormat("OME-Zarr: axis %c has the unit \"%s\", which is none of length, and "
                              "others have one",
                              absl::ascii_tolower(static_cast<unsigned char>(axis.letter)),
                              base::Printable(base::CutText(axis.unit, 40))));
    }
    factors[i] = factors[i] == 0 ? 1 : factors[i];
  }
  return factors;
}

absl::StatusOr<OmeImage> OneOmeImage(const ZarrJson& members, const ZarrJson& multiscale,
                                     const std::string& name) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOmeVersion(members, multiscale, name));
  OmeImage image{.name = TextOf(multiscale, "name")};
  ISOSCOPE_ASSIGN_OR_RETURN(image.axes, OmeAxesIn(multiscale, name));
  const ZarrJson* const levels = MemberOf(multiscale, "datasets");
  if (levels == nullptr || !levels->is_array() || levels->empty() ||
      levels->size() > kMaxOmeLevels) {
    return BadOme(name, "its list of datasets", levels,
                  absl::StrFormat("1 to %d levels", kMaxOmeLevels));
  }
  for (const ZarrJson& item : *levels) {
    OmeLevel level{.path = TextOf(item, "path"),
                   .scale = std::vector<double>(image.axes.size(), 1),
                   .translation = std::vector<double>(image.axes.size(), 0)};
    if (level.path.empty()) {
      return BadOme(name, "a level", &item, "one with a path");
    }
    ISOSCOPE_RETURN_IF_ERROR(
        ApplyOmeTransformations(MemberOf(item, "coordinateTransformations"), name, &level));
    ISOSCOPE_RETURN_IF_ERROR(
        ApplyOmeTransformations(MemberOf(multiscale, "coordinateTransformations"), name, &level));
    image.levels.push_back(std::move(level));
  }
  const ZarrJson* const omero = MemberOf(members, "omero");
  const ZarrJson* const channels = omero == nullptr ? nullptr : MemberOf(*omero, "channels");
  for (std::size_t i = 0;
       channels != nullptr && channels->is_array() && i < channels->size() && i < kMaxOmeChannels;
       ++i) {
    image.channels.push_back(TextOf((*channels)[i], "label"));
  }
  return image;
}

// A value of a label; not set for anything else than a finite number.
std::optional<double> LabelValueIn(const ZarrJson& item) {
  const ZarrJson* const value = MemberOf(item, "label-value");
  const auto number = value == nullptr ? std::nullopt : NumberOf(*value);
  return number.has_value() && std::isfinite(*number) ? number : std::nullopt;
}

std::string LabelNameIn(const ZarrJson& item) {
  for (const char* const member : {"name", "label", "class"}) {
    if (std::string text = TextOf(item, member); !text.empty()) {
      return text;
    }
  }
  std::string only;
  for (const auto& member : item.items()) {
    if (member.value().is_string()) {
      if (!only.empty()) {
        return "";
      }
      only = member.value().get<std::string>();
    }
  }
  return only;
}

std::optional<volume::LabelColor> LabelColorIn(const ZarrJson& item) {
  const std::vector<double> rgba = NumbersOf(item, "rgba");
  const bool is_color =
      (rgba.size() == 3 || rgba.size() == 4) &&
      std::all_of(rgba.begin(), rgba.end(), [](double c) { return c >= 0 && c <= 255; });
  return is_color ? std::optional(volume::LabelColor{.red = static_cast<std::uint8_t>(rgba[0]),
                                                     .green = static_cast<std::uint8_t>(rgba[1]),
                                                     .blue = static_cast<std::uint8_t>(rgba[2])})
                  : std::nullopt;
}

}  // namespace

absl::StatusOr<OmeImages> OmeImagesIn(const ZarrJson& attributes, const std::string& name) {
  const ZarrJson& members = OmeMembersOf(attributes);
  const ZarrJson* const list = MemberOf(members, "multiscales");
  OmeImages found;
  // Another convention of the same name (zarr-conventions/multiscales) has an object with a layout.
  if (list == nullptr || MemberOf(*list, "layout") != nullptr) {
    return found;
  }
  if (!list->is_array() || list->empty() || !list->front().is_object()) {
    return BadOme(name, "multiscales", list, "a list of images");
  }
  for (std::size_t i = 0; i < list->size() && i < kMaxOmeImages; ++i) {
    auto image = OneOmeImage(members, (*list)[i], name);
    if (image.ok()) {
      found.images.push_back(*std::move(image));
    } else if (i == 0) {
      return image.status();
    } else {
      found.others.Update(image.status());
    }
  }
  return found;
}

absl::StatusOr<std::optional<OmeImage>> OmeImageIn(const ZarrJson& attributes,
                                                   const std::string& name) {
  ISOSCOPE_ASSIGN_OR_RETURN(OmeImages found, OmeImagesIn(attributes, name));
  return found.images.empty() ? std::nullopt : std::optional(std::move(found.images.front()));
}

absl::StatusOr<std::vector<volume::Label>> OmeLabelTableIn(const ZarrJson& attributes) {
  std::vector<volume::Label> labels;
  const ZarrJson* const table = MemberOf(OmeMembersOf(attributes), "image-label");
  if (table == nullptr) {
    return labels;
  }
  std::map<double, volume::Label> by_value;
  for (const char* const member : {"properties", "colors"}) {
    const ZarrJson* const list = MemberOf(*table, member);
    if (list == nullptr || list->is_null()) {
      continue;
    }
    if (!list->is_array() || list->size() > volume::kMaxNamedLabels) {
      return absl::InvalidArgumentError(
          absl::StrFormat("OME-Zarr: %s of image-label is %s; expected a list of at most %d",
                          member, ShownJson(*list), volume::kMaxNamedLabels));
    }
    for (const ZarrJson& item : *list) {
      const auto value = LabelValueIn(item);
      if (!value.has_value()) {
        return absl::InvalidArgumentError(
            absl::StrFormat("OME-Zarr: %s of image-label has %s; expected one with a label-value",
                            member, ShownJson(item)));
      }
      volume::Label& label = by_value[*value + 0.0];  // -0 is 0
      label.value = *value + 0.0;
      if (label.name.empty()) {
        label.name = volume::CleanLabelName(LabelNameIn(item));
      }
      label.color = label.color.has_value() ? label.color : LabelColorIn(item);
    }
  }
  for (auto& [value, label] : by_value) {
    if (!label.name.empty() || label.color.has_value()) {
      labels.push_back(std::move(label));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(volume::ValidateLabels(labels));
  return labels;
}

std::vector<std::string> OmeLabelsIn(const ZarrJson& attributes) {
  const ZarrJson* const list = MemberOf(OmeMembersOf(attributes), "labels");
  std::vector<std::string> names;
  for (std::size_t i = 0;
       list != nullptr && list->is_array() && i < list->size() && i < kMaxOmeChannels; ++i) {
    if ((*list)[i].is_string()) {
      names.push_back((*list)[i].get<std::string>());
    }
  }
  return names;
}

std::string OmeCollectionIn(const ZarrJson& attributes) {
  const ZarrJson& members = OmeMembersOf(attributes);
  const ZarrJson* const plate = MemberOf(members, "plate");
  const ZarrJson* const wells = plate == nullptr ? nullptr : MemberOf(*plate, "wells");
  if (wells != nullptr && wells->is_array() && !wells->empty()) {
    return absl::StrCat("a plate of ", wells->size(), " wells; give an image of it: \"",
                        base::Printable(base::CutText(TextOf(wells->front(), "path"), 80)), "/0\"");
  }
  const ZarrJson* const well = MemberOf(members, "well");
  const ZarrJson* const images = well == nullptr ? nullptr : MemberOf(*well, "images");
  if (images != nullptr && images->is_array() && !images->empty()) {
    return absl::StrCat("a well of ", images->size(), " images; give one of them: \"",
                        base::Printable(base::CutText(TextOf(images->front(), "path"), 80)), "\"");
  }
  return "";
}

std::optional<std::array<std::size_t, 3>> OmeSpaceOf(const std::vector<OmeAxis>& axes) {
  std::array<std::size_t, 3> space{};
  std::size_t count = 0;
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    if (axes[axis].letter >= 'X' && axes[axis].letter <= 'Z' && count < space.size()) {
      space[count++] = axis;
    }
  }
  return count == space.size() ? std::optional(space) : std::nullopt;
}

std::string DescribeOmeAxes(const std::vector<OmeAxis>& axes) {
  return absl::StrJoin(axes, ", ", [](std::string* out, const OmeAxis& axis) {
    out->push_back(absl::ascii_tolower(static_cast<unsigned char>(axis.letter)));
  });
}

absl::StatusOr<OmeGrid> OmeGridOf(const OmeImage& image, std::size_t level, const ChunkIndex& dims,
                                  const GridRules& rules) {
  const std::array<std::size_t, 3> space = *OmeSpaceOf(image.axes);
  OmeGrid grid;
  ISOSCOPE_ASSIGN_OR_RETURN(const auto factors,
                            OmeUnitFactors(image.axes, space, rules, &grid.unit));
  volume::GridGeometry& geometry = grid.geometry;
  for (std::size_t i = 0; i < space.size(); ++i) {
    const std::size_t axis = space[i];
    const std::size_t index_axis = 2 - i;  // x is the fastest
    const char letter = image.axes[axis].letter;
    double scale = image.levels[level].scale[axis] * factors[i];
    double translation = image.levels[level].translation[axis] * factors[i];
    if ((!std::isfinite(scale) || scale == 0) && !rules.has_spacing) {
      return NoSampleDistance(
          "", absl::StrFormat("OME-Zarr: the scale of axis %c is %g",
                              absl::ascii_tolower(static_cast<unsigned char>(letter)), scale));
    }
    scale = std::isfinite(scale) && scale != 0 ? scale : 1;
    if (!std::isfinite(translation) && !rules.has_origin) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "OME-Zarr: the translation of axis %c is %g; expected a finite number, or --origin X,Y,Z",
          absl::ascii_tolower(static_cast<unsigned char>(letter)), translation));
    }
    translation = std::isfinite(translation) ? translation : 0;
    const std::array<std::int64_t*, 3> sizes = {&geometry.sample_dims.x, &geometry.sample_dims.y,
                                                &geometry.sample_dims.z};
    const std::array<double*, 3> spacings = {&geometry.spacing.x, &geometry.spacing.y,
                                             &geometry.spacing.z};
    *sizes[index_axis] = dims[axis];
    *spacings[index_axis] = std::abs(scale);
    math::Vec3d direction{0, 0, 0};
    OmeComponent(&direction, letter) = scale < 0 ? -1 : 1;
    geometry.direction.columns[index_axis] = direction;
    OmeComponent(&geometry.origin, letter) = translation;
  }
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(geometry));
  return grid;
}

std::string OmeLevelNote(const OmeImage& image, std::size_t level, const ChunkIndex& finest_dims,
                         const ChunkIndex& dims) {
  constexpr double kTolerance = 0.01;  // of a distance
  const OmeLevel& finest = image.levels[0];
  const OmeLevel& own = image.levels[level];
  const auto space = OmeSpaceOf(image.axes);
  for (std::size_t i = 0; space.has_value() && i < space->size(); ++i) {
    const std::size_t axis = (*space)[i];
    if (dims[axis] < 1 || finest.scale[axis] == 0) {
      continue;
    }
    const char letter = absl::ascii_tolower(static_cast<unsigned char>(image.axes[axis].letter));
    const double factor = own.scale[axis] / finest.scale[axis];
    // A last sample of fewer, or none of the rest.
    const auto size = static_cast<double>(dims[axis]);
    const auto whole = static_cast<double>(finest_dims[axis]);
    if (factor * (size + 1) < whole * (1 - kTolerance) ||
        factor * (size - 1) > whole * (1 + kTolerance)) {
      return absl::StrFormat(
          "level %d has %d of %d samples along %c, and distances %g times those of level 0", level,
          dims[axis], finest_dims[axis], letter, factor);
    }
    const double expected = finest.translation[axis] + (factor - 1) / 2 * finest.scale[axis];
    if (std::abs(own.translation[axis] - expected) > kTolerance * std::abs(own.scale[axis])) {
      return absl::StrFormat(
          "level %d begins at %g along %c in the file, and means of %g samples of level 0 at %g",
          level, own.translation[axis], letter, factor, expected);
    }
  }
  return "";
}

}  // namespace isoscope::source
