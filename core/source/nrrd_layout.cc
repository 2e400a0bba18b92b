// Four axes, one of which is not of space:
//
//   dimension: 4
//   sizes: 3 64 64 93                             fastest first
//   kinds: 3-vector domain domain domain          or "list", "time", ...; a space has "domain"
//   space: right-anterior-superior
//   space directions: none (1,0,0) (0,1,0) (0,0,2)
//   space origin: (0,0,0)
//   spacings: nan 1 1 2                           in place of the directions
//   units: "" "mm" "mm" "mm"
//
// ITK reads such files only where the kind is none of a domain, and "time" is one. So the grid is
// read here, and turned to LPS as ITK does. Source: http://teem.sourceforge.net/nrrd/format.html,
// sections 5 and 6.

#include "core/source/nrrd_layout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

struct NrrdTypeName {
  const char* name;  // without "signed", "unsigned", "int" behind another word, and "_t"
  volume::ScalarType signed_type;
  volume::ScalarType unsigned_type;
};
constexpr std::array<NrrdTypeName, 3> kNrrdTypes{
    {{"char", volume::ScalarType::kInt8, volume::ScalarType::kUint8},
     {"short", volume::ScalarType::kInt16, volume::ScalarType::kUint16},
     {"int", volume::ScalarType::kInt32, volume::ScalarType::kUint32}}};

// The lists of a header that have one entry for each axis.
struct AxisLists {
  std::vector<std::int64_t> sizes;
  std::vector<std::string> kinds;
  std::vector<std::string> directions;
  std::vector<std::string> spacings;
  std::vector<std::string> units;
};

absl::Status Invalid(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": NRRD header: ", what));
}

absl::StatusOr<AxisLists> ReadLists(const HeaderFields& fields, const std::string& path) {
  AxisLists lists;
  ISOSCOPE_ASSIGN_OR_RETURN(lists.sizes, fields.GetIntegers("sizes"));
  if (lists.sizes.size() != 4 || *std::min_element(lists.sizes.begin(), lists.sizes.end()) < 1) {
    return Invalid(
        path, absl::StrFormat("sizes \"%s\"; expected four of 1 or more", fields.Get("sizes")));
  }
  for (const auto& [field, list] :
       std::initializer_list<std::pair<const char*, std::vector<std::string>*>>{
           {"kinds", &lists.kinds},
           {"space directions", &lists.directions},
           {"spacings", &lists.spacings},
           {"units", &lists.units}}) {
    *list = SplitNrrdList(fields.Get(field));
    if (!list->empty() && list->size() != lists.sizes.size()) {
      return Invalid(path, absl::StrFormat("%d %s for %d axes: \"%s\"", list->size(), field,
                                           lists.sizes.size(), fields.Get(field)));
    }
  }
  return lists;
}

bool IsOfSpace(const AxisLists& lists, std::size_t axis) {
  if (!lists.directions.empty()) {
    return lists.directions[axis] != "none";
  }
  const std::string kind = lists.kinds.empty() ? "" : absl::AsciiStrToLower(lists.kinds[axis]);
  return kind.empty() || kind == "domain" || kind == "space" || kind == "none" || kind == "???";
}

// "(1,0,-0.5)".
absl::StatusOr<math::Vec3d> ParseVector(const std::string& text, const char* field,
                                        const std::string& path) {
  math::Vec3d vector;
  const std::vector<std::string> numbers =
      absl::StrSplit(text, absl::ByAnyChar("(), \t"), absl::SkipEmpty());
  bool is_vector = numbers.size() == 3;
  for (int i = 0; is_vector && i < 3; ++i) {
    is_vector = absl::SimpleAtod(numbers[static_cast<std::size_t>(i)], &vector[i]);
  }
  if (!is_vector) {
    return Invalid(path, absl::StrFormat("%s \"%s\"; expected three numbers", field, text));
  }
  return vector;
}

// These turn the file's world to LPS: factors of x, y and z.
absl::StatusOr<math::Vec3d> TurnOf(const std::string& space, const std::string& path) {
  if (space == "right-anterior-superior" || space == "ras") {
    return math::Vec3d{-1, -1, 1};
  }
  if (space == "left-anterior-superior" || space == "las") {
    return Invalid(path,
                   "space left-anterior-superior; expected left-posterior-superior or "
                   "right-anterior-superior");
  }
  return math::Vec3d{1, 1, 1};
}

absl::Status SetGrid(const HeaderFields& fields, const AxisLists& lists, std::size_t first_axis,
                     const std::string& path, NrrdLayout* layout) {
  const std::string space = absl::AsciiStrToLower(fields.Get("space"));
  ISOSCOPE_ASSIGN_OR_RETURN(const math::Vec3d turn, TurnOf(space, path));
  volume::GridGeometry& geometry = layout->geometry;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<int>(axis);
    const std::size_t from = first_axis + axis;
    geometry.sample_dims[index] = lists.sizes[from];
    if (!lists.directions.empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(math::Vec3d step,
                                ParseVector(lists.directions[from], "space directions", path));
      step = {step.x * turn.x, step.y * turn.y, step.z * turn.z};
      const double length = std::sqrt(step.x * step.x + step.y * step.y + step.z * step.z);
      geometry.spacing[index] = length;
      geometry.direction.columns[axis] = step * (1 / length);
    } else if (lists.spacings.empty() ||
               !absl::SimpleAtod(lists.spacings[from], &geometry.spacing[index])) {
      return Invalid(path, absl::StrFormat("no space directions, and spacings \"%s\"",
                                           fields.Get("spacings")));
    }
  }
  if (!fields.Get("space origin").empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const math::Vec3d origin,
                              ParseVector(fields.Get("space origin"), "space origin", path));
    geometry.origin = {origin.x * turn.x, origin.y * turn.y, origin.z * turn.z};
  }
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  if (turn.x < 0 || space == "left-posterior-superior" || space == "lps") {
    layout->patient_frame.emplace();
  }
  return absl::OkStatus();
}

}  // namespace

std::optional<NrrdSampleType> NrrdTypeFromName(absl::string_view name) {
  const std::string lower = absl::AsciiStrToLower(absl::StripAsciiWhitespace(name));
  if (lower == "float" || lower == "double") {
    return NrrdSampleType{.scalar = lower == "float" ? volume::ScalarType::kFloat32
                                                     : volume::ScalarType::kFloat64};
  }
  const auto sized = volume::ScalarTypeFromName(absl::StripSuffix(lower, "_t"));
  std::optional<WideType> wide = WideTypeFromName(absl::StripSuffix(lower, "_t"));
  if (wide == WideType::kFloat16 || (sized.ok() && absl::StartsWith(lower, "float"))) {
    return std::nullopt;  // no names of NRRD
  }
  if (sized.ok()) {
    return NrrdSampleType{.scalar = *sized};
  }
  bool is_unsigned = false;
  std::vector<std::string> words = absl::StrSplit(lower, ' ', absl::SkipEmpty());
  if (!words.empty() && (words[0] == "unsigned" || words[0] == "signed")) {
    is_unsigned = words[0] == "unsigned";
    words.erase(words.begin());
  } else if (words.size() == 1 && words[0] != "uint" && words[0].size() > 1 && words[0][0] == 'u') {
    is_unsigned = true;
    words[0].erase(0, 1);
  } else if (words.size() == 1 && words[0] == "uint") {
    is_unsigned = true;
    words[0] = "int";
  }
  if (words.size() > 1 && words.back() == "int") {
    words.pop_back();
  }
  const bool is_long_long = words == std::vector<std::string>{"long", "long"} ||
                            words == std::vector<std::string>{"longlong"};
  if (!wide.has_value() && is_long_long) {
    wide = is_unsigned ? WideType::kUint64 : WideType::kInt64;
  }
  if (wide.has_value()) {
    return NrrdSampleType{.scalar = CarrierType(*wide), .wide = wide};
  }
  for (const NrrdTypeName& known : kNrrdTypes) {
    if (words.size() == 1 && words[0] == known.name) {
      return NrrdSampleType{.scalar = is_unsigned ? known.unsigned_type : known.signed_type};
    }
  }
  return std::nullopt;
}

std::vector<std::string> SplitNrrdList(absl::string_view text) {
  std::vector<std::string> parts;
  std::size_t at = 0;
  while ((at = text.find_first_not_of(" \t", at)) != absl::string_view::npos) {
    const char close = text[at] == '(' ? ')' : text[at] == '"' ? '"' : ' ';
    std::size_t end = close == ' ' ? text.find_first_of(" \t", at) : text.find(close, at + 1);
    end = std::min(end, text.size());
    if (close == '"') {
      parts.emplace_back(text.substr(at + 1, end - at - 1));
    } else {
      parts.emplace_back(text.substr(at, close == ')' ? end - at + 1 : end - at));
    }
    at = end + (close == ' ' ? 0 : 1);
    if (at > text.size()) {
      break;
    }
  }
  return parts;
}

absl::StatusOr<NrrdLayout> ReadNrrdLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadNrrdFields(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const AxisLists lists, ReadLists(fields, path));
  NrrdLayout layout;
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(fields.Get("type"));
  if (!type.has_value()) {
    return Invalid(path, absl::StrFormat("samples of type \"%s\"; expected integers of 8 to 64 "
                                         "bits, float or double",
                                         fields.Get("type")));
  }
  layout.type = *type;
  std::vector<std::size_t> others;
  for (std::size_t axis = 0; axis < 4; ++axis) {
    if (!IsOfSpace(lists, axis)) {
      others.push_back(axis);
    }
  }
  if (others.size() != 1 || (others[0] != 0 && others[0] != 3) ||
      !fields.Get("axis mins").empty() || !fields.Get("axismins").empty()) {
    return Invalid(
        path,
        absl::StrFormat("%s samples, kinds \"%s\", space directions \"%s\"; expected one axis that "
                        "is not of space, the first or the last, as in \"kinds: domain domain "
                        "domain time\", and no axis mins",
                        fields.Get("sizes"), fields.Get("kinds"), fields.Get("space directions")));
  }
  const std::size_t other = others[0];
  (other == 0 ? layout.tuples : layout.volumes) = lists.sizes[other];
  ISOSCOPE_RETURN_IF_ERROR(SetGrid(fields, lists, other == 0 ? 1 : 0, path, &layout));
  layout.is_time = !lists.kinds.empty() && absl::EqualsIgnoreCase(lists.kinds[other], "time");
  double interval = 0;
  if (layout.is_time && !lists.spacings.empty() &&
      absl::SimpleAtod(lists.spacings[other], &interval) && std::isfinite(interval) &&
      interval > 0) {
    layout.interval = interval;
  }
  if (layout.is_time && !lists.units.empty()) {
    layout.time_unit = lists.units[other];
  }
  const std::vector<std::string> space_units = SplitNrrdList(fields.Get("space units"));
  if (!space_units.empty()) {
    layout.length_unit = space_units[0];
  } else if (!lists.units.empty()) {
    layout.length_unit = lists.units[other == 0 ? 1 : 0];
  }
  const std::vector<std::string> sample_unit = SplitNrrdList(fields.Get("sample units"));
  layout.sample_unit = sample_unit.empty() ? "" : sample_unit[0];
  return layout;
}

}  // namespace isoscope::source
