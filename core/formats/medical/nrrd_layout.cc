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
// ITK reads such files only where the kind is none of a domain, and "time" is one. Source:
// http://teem.sourceforge.net/nrrd/format.html, sections 5 and 6.

#include "core/formats/medical/nrrd_layout.h"

#include <array>
#include <cmath>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
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

absl::StatusOr<NrrdLayout> ReadNrrdLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadNrrdFields(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const NrrdAxisLists lists, ReadNrrdLists(fields, path));
  if (lists.sizes.size() != 4) {
    return NrrdError(path,
                     absl::StrFormat("sizes \"%s\"; expected four of them", fields.Get("sizes")));
  }
  NrrdLayout layout;
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(fields.Get("type"));
  if (!type.has_value()) {
    return NrrdError(path, absl::StrFormat("samples of type \"%s\"; expected integers of 8 to 64 "
                                           "bits, float or double",
                                           fields.Get("type")));
  }
  layout.type = *type;
  std::vector<std::size_t> others;
  for (std::size_t axis = 0; axis < 4; ++axis) {
    if (!IsNrrdAxisOfSpace(lists, axis)) {
      others.push_back(axis);
    }
  }
  if (others.size() != 1 || (others[0] != 0 && others[0] != 3)) {
    return NrrdError(
        path,
        absl::StrFormat("%s samples, kinds \"%s\", space directions \"%s\"; expected one axis that "
                        "is not of space, the first or the last, as in \"kinds: domain domain "
                        "domain time\"",
                        fields.Get("sizes"), fields.Get("kinds"), fields.Get("space directions")));
  }
  const std::size_t other = others[0];
  (other == 0 ? layout.tuples : layout.volumes) = lists.sizes[other];
  ISOSCOPE_ASSIGN_OR_RETURN(layout.grid, ReadNrrdGrid(fields, lists, other == 0 ? 1 : 0, path));
  const bool has_direction =
      !lists.directions.empty() && absl::StartsWith(lists.directions[other], "(");
  layout.is_time =
      has_direction || (!lists.kinds.empty() && absl::EqualsIgnoreCase(lists.kinds[other], "time"));
  double interval = NrrdNumber(lists.spacings, other);
  if (has_direction) {  // "(0,0,0,0.5)"
    const std::string& text = lists.directions[other];
    interval =
        NrrdNumber({text.substr(text.rfind(',') + 1, text.rfind(')') - text.rfind(',') - 1)}, 0);
  }
  if (layout.is_time && std::isfinite(interval) && interval > 0) {
    layout.interval = interval;
  }
  if (layout.is_time && !lists.units.empty()) {
    layout.time_unit = lists.units[other];
  }
  const std::vector<std::string> sample_unit = SplitNrrdList(fields.Get("sample units"));
  layout.sample_unit = sample_unit.empty() ? "" : sample_unit[0];
  return layout;
}

}  // namespace isoscope::source
