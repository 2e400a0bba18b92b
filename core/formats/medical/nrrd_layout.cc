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
//   axis mins: nan nan nan nan                    of time: that of the first step
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

absl::Status CheckInterval(double interval, std::size_t axis, const std::string& path) {
  return std::isfinite(interval) && interval > 0
             ? absl::OkStatus()
             : NrrdError(path,
                         absl::StrFormat("steps are %g apart along axis %d, of time; expected "
                                         "a distance above 0, or nan for one that is not "
                                         "known",
                                         interval, axis));
}

// The axis is one of a space with time.
absl::Status SetTimesByDirection(const NrrdAxisLists& lists, std::size_t axis,
                                 const std::string& path, NrrdLayout* layout) {
  const std::string& text = lists.directions[axis];  // "(0,0,0,0.5)"
  for (const auto* list : {&lists.spacings, &lists.mins, &lists.maxs}) {
    if (!std::isnan(NrrdNumber(*list, axis))) {
      return NrrdError(path, absl::StrFormat("axis %d has the direction %s, and a spacing or "
                                             "bounds, %s; expected one of both",
                                             axis, text, (*list)[axis]));
    }
  }
  const std::size_t comma = text.rfind(',');
  layout->interval = NrrdNumber({text.substr(comma + 1, text.rfind(')') - comma - 1)}, 0);
  ISOSCOPE_RETURN_IF_ERROR(CheckInterval(layout->interval, axis, path));
  layout->first_time = layout->grid.first_time;
  if (!std::isfinite(layout->first_time)) {
    return NrrdError(path, absl::StrFormat("the time of the space origin is %g; expected a finite "
                                           "number",
                                           layout->first_time));
  }
  layout->time_unit = layout->grid.time_unit;
  if (layout->time_unit.empty() && !lists.units.empty()) {
    layout->time_unit = lists.units[axis];
  }
  return absl::OkStatus();
}

// The distance of steps by the bounds of their axis, and whether these are those of cells. Without
// a word of the header on that, the spacing decides.
absl::Status TakeTimeBounds(const NrrdAxisLists& lists, std::size_t axis, double min, double max,
                            const std::string& path, double* interval, bool* is_cell) {
  const std::string center =
      lists.centers.empty() ? "" : absl::AsciiStrToLower(lists.centers[axis]);
  const auto size = static_cast<double>(lists.sizes[axis]);
  const double by_node = (max - min) / (size - 1);
  const double by_cell = (max - min) / size;
  constexpr double kTolerance = 1e-3;
  const auto fits = [&](double step) {
    return std::abs(step - *interval) <= kTolerance * std::abs(step);
  };
  const bool is_known = center == "cell" || center == "node";
  *is_cell = center == "cell" || (!is_known && !fits(by_node));
  if (std::isnan(*interval) && is_known) {
    *interval = *is_cell ? by_cell : by_node;
  }
  return std::isfinite(min) && std::isfinite(max) && fits(*is_cell ? by_cell : by_node)
             ? absl::OkStatus()
             : NrrdError(path, absl::StrFormat(
                                   "axis %d, of time, goes from %g to %g (axis mins, axis maxs) in "
                                   "%d steps %g apart; expected bounds that fit the distance, or "
                                   "centers that say whether they are of cells or of samples",
                                   axis, min, max, lists.sizes[axis], *interval));
}

// Without a distance steps have numbers, and no unit.
absl::Status SetTimesBySpacing(const NrrdAxisLists& lists, std::size_t axis,
                               const std::string& path, NrrdLayout* layout) {
  const double min = NrrdNumber(lists.mins, axis);
  const double max = NrrdNumber(lists.maxs, axis);
  double interval = NrrdNumber(lists.spacings, axis);
  bool is_cell = !lists.centers.empty() && absl::EqualsIgnoreCase(lists.centers[axis], "cell");
  if (!std::isnan(max)) {
    ISOSCOPE_RETURN_IF_ERROR(TakeTimeBounds(lists, axis, min, max, path, &interval, &is_cell));
  }
  if (std::isnan(interval) && std::isnan(min)) {
    return absl::OkStatus();
  }
  if (std::isnan(interval) || std::isinf(min)) {
    return NrrdError(path, absl::StrFormat("axis %d, of time, begins at %g (axis mins), and its "
                                           "steps are %g apart; expected finite numbers, or nan "
                                           "for both",
                                           axis, min, interval));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckInterval(interval, axis, path));
  layout->interval = interval;
  layout->first_time = std::isnan(min) ? 0 : min + (is_cell ? interval / 2 : 0);
  layout->time_unit = lists.units.empty() ? "" : lists.units[axis];
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
  if (layout.is_time && lists.sizes[other] > 1) {
    ISOSCOPE_RETURN_IF_ERROR(has_direction ? SetTimesByDirection(lists, other, path, &layout)
                                           : SetTimesBySpacing(lists, other, path, &layout));
  }
  const std::vector<std::string> sample_unit = SplitNrrdList(fields.Get("sample units"));
  layout.sample_unit = sample_unit.empty() ? "" : sample_unit[0];
  return layout;
}

}  // namespace isoscope::source
