// Axes of space have directions, in a space that says what its axes are:
//
//   space: right-anterior-superior           or "space dimension: 3"
//   space directions: (1,0,0) (0,1,0) (0,0,2)
//   space origin: (0,0,0)
//   space units: "mm" "mm" "mm"              of the space's axes
//
// or each a distance, and perhaps bounds, along an axis of the world of its own:
//
//   spacings: 1 1 2                          nan: not known; negative: against the axis
//   axis mins: -3 -3 0                       where the first sample lies, or its cell begins
//   axis maxs: 3 3 8
//   centers: cell cell node                  which of both; cell if the header does not say
//   units: "mm" "mm" "mm"                    of the axes
//
// Spaces of the patient are turned to LPS. Those "-time" have a fourth number in each vector, which
// is 0 for the axes of space. Source: http://teem.sourceforge.net/nrrd/format.html, sections 5 and
// 6; the default of centers is that of ITK.

#include "core/formats/medical/nrrd_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/source/grid/sample_distance.h"
#include "core/source/grid/stack_layout.h"

namespace isoscope::source {
namespace {

struct NrrdSpace {
  const char* name;  // without hyphens and spaces, in lower case, without "time"
  const char* short_name;
  math::Vec3d turn;  // factors that turn it to LPS
  bool is_of_patient;
};
constexpr std::array<NrrdSpace, 5> kNrrdSpaces{
    {{"rightanteriorsuperior", "ras", {-1, -1, 1}, true},
     {"leftanteriorsuperior", "las", {1, -1, 1}, true},
     {"leftposteriorsuperior", "lps", {1, 1, 1}, true},
     {"scannerxyz", "scannerxyz", {1, 1, 1}, false},
     {"3drighthanded", "3drighthanded", {1, 1, 1}, false}}};

// The place of a header's world in ours.
struct NrrdWorld {
  math::Vec3d turn{1, 1, 1};
  bool is_of_patient = false;
  std::size_t rank = 3;  // numbers of a vector; 4 with time
};

absl::StatusOr<NrrdWorld> WorldOf(const HeaderFields& fields, const std::string& path) {
  const std::string text = fields.Get("space");
  NrrdWorld world;
  if (text.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t rank, fields.GetInteger("space dimension", 3));
    if (rank != 3) {
      return NrrdError(path, absl::StrFormat("space dimension %d; expected 3", rank));
    }
    return world;
  }
  const std::string name = absl::StrReplaceAll(absl::AsciiStrToLower(text), {{"-", ""}, {" ", ""}});
  for (const NrrdSpace& space : kNrrdSpaces) {
    const bool has_time = name == absl::StrCat(space.name, "time") ||
                          name == absl::StrCat(space.short_name, "time") ||
                          (space.is_of_patient && name == absl::StrCat(space.short_name, "t"));
    if (has_time || name == space.name || name == space.short_name) {
      return NrrdWorld{
          .turn = space.turn, .is_of_patient = space.is_of_patient, .rank = has_time ? 4U : 3U};
    }
  }
  return NrrdError(
      path, absl::StrFormat("space \"%s\"; expected left-posterior-superior, right- or "
                            "left-anterior-superior, scanner-xyz or 3D-right-handed%s",
                            text.substr(0, 60),
                            absl::StartsWith(name, "3dlefthanded")
                                ? ": its picture would be mirrored; change the sign of the last "
                                  "number of each direction and of the origin, and call the space "
                                  "3D-right-handed"
                                : ""));
}

// "(1,0,-0.5)": numbers, any of them; none if a part is no number.
std::vector<double> NumbersIn(absl::string_view text) {
  std::vector<double> numbers;
  for (const absl::string_view part :
       absl::StrSplit(text, absl::ByAnyChar("(), \t"), absl::SkipEmpty())) {
    if (!absl::SimpleAtod(part, &numbers.emplace_back())) {
      return {};
    }
  }
  return numbers;
}

// A vector of the space, of any numbers. INVALID_ARGUMENT: not as many as it has axes; a time.
absl::StatusOr<math::Vec3d> ParseNrrdVector(absl::string_view text, const char* field,
                                            const NrrdWorld& world, bool may_have_time,
                                            const std::string& path) {
  const std::vector<double> numbers = NumbersIn(text);
  if (numbers.size() != world.rank || (world.rank == 4 && !may_have_time && numbers[3] != 0)) {
    return NrrdError(path, absl::StrFormat("%s \"%s\"; expected %d numbers%s", field, text,
                                           world.rank, world.rank == 4 ? ", the last one 0" : ""));
  }
  return math::Vec3d{numbers[0] * world.turn.x, numbers[1] * world.turn.y,
                     numbers[2] * world.turn.z};
}

// The distance of samples along an axis without a direction, and the position of the first one.
// NaN: not known.
struct NrrdAxis {
  double step = std::numeric_limits<double>::quiet_NaN();
  double first = std::numeric_limits<double>::quiet_NaN();
};

absl::StatusOr<NrrdAxis> AxisOf(const NrrdAxisLists& lists, std::size_t axis,
                                const std::string& path) {
  const double spacing = NrrdNumber(lists.spacings, axis);
  const double min = NrrdNumber(lists.mins, axis);
  const double max = NrrdNumber(lists.maxs, axis);
  const auto size = static_cast<double>(lists.sizes[axis]);
  const std::string center =
      lists.centers.empty() ? "" : absl::AsciiStrToLower(lists.centers[axis]);
  const bool has_bounds = std::isfinite(min) && std::isfinite(max) && size > 1;
  const double by_node = has_bounds ? (max - min) / (size - 1) : min;
  const double by_cell = has_bounds ? (max - min) / size : min;
  constexpr double kTolerance = 1e-3;
  const auto fits = [&](double step) {
    return std::abs(step - spacing) <= kTolerance * std::abs(step);
  };
  const bool is_node =
      center == "node" || (center != "cell" && has_bounds && fits(by_node) && !fits(by_cell));
  NrrdAxis found{.step = spacing};
  if (has_bounds) {
    const double by_bounds = is_node ? by_node : by_cell;
    if (!std::isnan(spacing) && !fits(by_bounds)) {
      return NrrdError(path, absl::StrFormat("axis %d has the spacing %g, but its bounds %g and %g "
                                             "are those of %g; expected one of both",
                                             axis, spacing, min, max, by_bounds));
    }
    found.step = std::isnan(spacing) ? by_bounds : spacing;
  }
  if (std::isfinite(min)) {
    found.first = min + (is_node ? 0 : found.step / 2);
  } else if (std::isfinite(max)) {
    return NrrdError(path, absl::StrFormat("axis %d ends at %g (axis maxs), and nothing says where "
                                           "it begins; expected axis mins, too",
                                           axis, max));
  }
  return found;
}

// The unit of three axes, and the factors that turn their lengths to it. That of some axes alone is
// passed over: lengths have no unit then.
absl::StatusOr<std::string> CommonUnit(const std::vector<std::string>& units,
                                       std::array<double, 3>* factors, const std::string& path) {
  *factors = {1, 1, 1};
  std::vector<std::string> named = units;
  std::erase(named, "");
  if (std::adjacent_find(named.begin(), named.end(), std::not_equal_to<>()) == named.end()) {
    return named.size() == 3 ? named[0] : "";
  }
  const std::optional<LengthUnit> first = LengthUnitOf(units[0]);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::optional<LengthUnit> own = LengthUnitOf(units[axis]);
    if (!first.has_value() || !own.has_value()) {
      return NrrdError(path, absl::StrFormat("axes of space in \"%s\"; expected one unit, or units "
                                             "of length",
                                             absl::StrJoin(units, "\", \"")));
    }
    (*factors)[axis] = own->metres / first->metres;
  }
  return units[0];
}

// Sets the grid by the fields of its space:
//
// 1. One unit of length for the axes of space, and a unit of time.
// 2. Distance and direction of each axis, or the faults of the grid.
// 3. The origin, and its time.
absl::Status SetByDirections(const HeaderFields& fields, const NrrdAxisLists& lists,
                             std::size_t first, const NrrdWorld& world, const std::string& path,
                             NrrdGrid* grid) {
  // 1. Units.
  std::vector<std::string> units = SplitNrrdList(fields.Get("space units"));
  if (!units.empty() && units.size() != world.rank) {
    return NrrdError(path, absl::StrFormat("space units %s; expected %d units, one of each axis of "
                                           "the space",
                                           fields.Get("space units"), world.rank));
  }
  if (units.size() == 4) {
    grid->time_unit = units[3];
    units.pop_back();
  }
  std::array<double, 3> factors{};
  ISOSCOPE_ASSIGN_OR_RETURN(grid->length_unit, CommonUnit(units, &factors, path));
  const auto scaled = [&](const math::Vec3d& v) {
    return math::Vec3d{v.x * factors[0], v.y * factors[1], v.z * factors[2]};
  };
  // 2. Distances and directions.
  volume::GridGeometry& geometry = grid->geometry;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string& text = lists.directions[first + axis];
    if (absl::EqualsIgnoreCase(text, "none")) {
      const std::string what = absl::StrFormat(
          "NRRD header: the space direction of axis %d is \"none\": it is not of space",
          first + axis);
      grid->faults.distances.Update(NoSampleDistance(path, what));
      grid->faults.directions.Update(NoDirections(path, what));
      geometry.direction.columns[axis] = {0, 0, 0};
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(math::Vec3d step,
                              ParseNrrdVector(text, "space directions", world, false, path));
    step = scaled(step);
    const double length = std::sqrt(step.x * step.x + step.y * step.y + step.z * step.z);
    for (const auto* list : {&lists.spacings, &lists.mins, &lists.maxs}) {
      if (!std::isnan(NrrdNumber(*list, first + axis))) {
        return NrrdError(path, absl::StrFormat("axis %d has the direction %s, and a spacing or "
                                               "bounds, %s; expected one of both",
                                               first + axis, text, (*list)[first + axis]));
      }
    }
    const bool has_length = length > 0 && std::isfinite(length);
    if (!has_length) {
      const std::string what =
          absl::StrFormat("NRRD header: space directions \"%s\" of axis %d %s", text, first + axis,
                          length == 0 ? "has no length" : "has other than finite numbers");
      grid->faults.distances.Update(NoSampleDistance(path, what));
      grid->faults.directions.Update(NoDirections(path, what));
    }
    geometry.spacing[static_cast<int>(axis)] = has_length ? length : 1;
    geometry.direction.columns[axis] = has_length ? step * (1 / length) : math::Vec3d{0, 0, 0};
  }
  // 3. The origin.
  if (!fields.Get("space origin").empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const math::Vec3d origin,
        ParseNrrdVector(fields.Get("space origin"), "space origin", world, true, path));
    geometry.origin = scaled(origin);
    if (world.rank == 4) {
      grid->first_time = NumbersIn(fields.Get("space origin"))[3];
    }
  }
  return absl::OkStatus();
}

absl::Status SetBySpacings(const NrrdAxisLists& lists, std::size_t first, const std::string& path,
                           NrrdGrid* grid) {
  std::vector<std::string> units;
  if (!lists.units.empty()) {
    units.assign(lists.units.begin() + static_cast<std::ptrdiff_t>(first),
                 lists.units.begin() + static_cast<std::ptrdiff_t>(first) + 3);
  }
  std::array<double, 3> factors{};
  ISOSCOPE_ASSIGN_OR_RETURN(grid->length_unit, CommonUnit(units, &factors, path));
  std::array<NrrdAxis, 3> axes;
  std::size_t steps = 0;
  std::size_t firsts = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(axes[axis], AxisOf(lists, first + axis, path));
    steps += std::isnan(axes[axis].step) ? 0U : 1U;
    firsts += std::isnan(axes[axis].first) ? 0U : 1U;
  }
  if (firsts > 0 && firsts < 3 && steps == 3) {
    return NrrdError(path, absl::StrFormat("axis mins \"%s\" for some axes; expected one for each "
                                           "axis of space, or none",
                                           absl::StrJoin(lists.mins, " ")));
  }
  volume::GridGeometry& geometry = grid->geometry;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int index = static_cast<int>(axis);
    double step = axes[axis].step * factors[axis];
    const bool is_known = std::abs(step) > 0 && std::isfinite(step);
    if (steps > 0 && !is_known) {
      grid->faults.distances.Update(NoSampleDistance(
          path,
          absl::StrFormat("NRRD header: the distance of samples along axis %d is %s (spacings "
                          "\"%s\")",
                          first + axis, std::isnan(step) ? "not known" : absl::StrCat(step),
                          absl::StrJoin(lists.spacings, " "))));
    }
    step = is_known ? step : 1;
    geometry.spacing[index] = std::abs(step);
    geometry.direction.columns[axis][index] = step < 0 ? -1 : 1;
  }
  for (std::size_t axis = 0; axis < 3 && firsts == 3 && steps == 3 && grid->faults.ok(); ++axis) {
    geometry.origin[static_cast<int>(axis)] = axes[axis].first * factors[axis];
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status NrrdError(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": NRRD header: ", what));
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

absl::StatusOr<NrrdAxisLists> ReadNrrdLists(const HeaderFields& fields, const std::string& path) {
  NrrdAxisLists lists;
  ISOSCOPE_ASSIGN_OR_RETURN(lists.sizes, fields.GetIntegers("sizes"));
  if (lists.sizes.empty() || *std::min_element(lists.sizes.begin(), lists.sizes.end()) < 1) {
    return NrrdError(path,
                     absl::StrFormat("sizes \"%s\"; expected 1 or more each", fields.Get("sizes")));
  }
  struct Names {
    const char* name;
    const char* other;
    std::vector<std::string>* list;
  };
  for (const Names& names :
       std::initializer_list<Names>{{"kinds", "kinds", &lists.kinds},
                                    {"space directions", "space directions", &lists.directions},
                                    {"spacings", "spacings", &lists.spacings},
                                    {"axis mins", "axismins", &lists.mins},
                                    {"axis maxs", "axismaxs", &lists.maxs},
                                    {"centers", "centerings", &lists.centers},
                                    {"units", "units", &lists.units}}) {
    const std::string text = fields.Get(fields.Get(names.name).empty() ? names.other : names.name);
    *names.list = SplitNrrdList(text);
    if (!names.list->empty() && names.list->size() != lists.sizes.size()) {
      return NrrdError(path, absl::StrFormat("%d %s for %d axes: \"%s\"", names.list->size(),
                                             names.name, lists.sizes.size(), text));
    }
  }
  for (const auto* list : {&lists.spacings, &lists.mins, &lists.maxs}) {
    double number = 0;
    for (const std::string& word : *list) {
      if (!absl::SimpleAtod(word, &number)) {
        return NrrdError(path, absl::StrFormat("\"%s\" among spacings or bounds of axes; expected "
                                               "numbers, or nan for those that are not known",
                                               word));
      }
    }
  }
  return lists;
}

bool IsNrrdKindOfSpace(absl::string_view kind) {
  const std::string lower = absl::AsciiStrToLower(kind);
  return lower.empty() || lower == "domain" || lower == "space" || lower == "none" ||
         lower == "???";
}

bool IsNrrdAxisOfSpace(const NrrdAxisLists& lists, std::size_t axis) {
  if (!lists.directions.empty()) {
    const std::vector<double> numbers = NumbersIn(lists.directions[axis]);
    const bool is_time = numbers.size() == 4 && numbers[0] == 0 && numbers[1] == 0 &&
                         numbers[2] == 0 && numbers[3] != 0;
    return absl::AsciiStrToLower(lists.directions[axis]) != "none" && !is_time;
  }
  return lists.kinds.empty() || IsNrrdKindOfSpace(lists.kinds[axis]);
}

double NrrdNumber(const std::vector<std::string>& list, std::size_t axis) {
  double number = 0;
  return axis < list.size() && absl::SimpleAtod(list[axis], &number)
             ? number
             : std::numeric_limits<double>::quiet_NaN();
}

absl::StatusOr<NrrdGrid> ReadNrrdGrid(const HeaderFields& fields, const NrrdAxisLists& lists,
                                      std::size_t first, const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NrrdWorld world, WorldOf(fields, path));
  NrrdGrid grid;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    grid.geometry.sample_dims[static_cast<int>(axis)] = lists.sizes[first + axis];
  }
  if (lists.directions.empty() && !fields.Get("space").empty() && !lists.spacings.empty()) {
    return NrrdError(path, absl::StrFormat("space \"%s\" with spacings \"%s\"; expected space "
                                           "directions: spacings do not say how axes lie in it",
                                           fields.Get("space"), fields.Get("spacings")));
  }
  ISOSCOPE_RETURN_IF_ERROR(lists.directions.empty()
                               ? SetBySpacings(lists, first, path, &grid)
                               : SetByDirections(fields, lists, first, world, path, &grid));
  ReplaceFaults(absl::StrCat(path, ": NRRD header"), &grid.geometry, &grid.faults);
  const absl::Status valid = volume::Validate(grid.geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  if (world.is_of_patient && !lists.directions.empty()) {
    grid.patient_frame.emplace();
  }
  return grid;
}

}  // namespace isoscope::source
