// Source: CF Metadata Conventions 1.10, chapters 4 (coordinate types) and 5 (coordinate systems),
// https://cfconventions.org.

#include "core/source/cf_grid.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/axis_order.h"

namespace isoscope::source {
namespace {

struct CfWord {
  const char* text;
  char letter;
};
constexpr std::array<CfWord, 12> kCfUnits{{{"degrees_east", 'X'},
                                           {"degree_east", 'X'},
                                           {"degrees_e", 'X'},
                                           {"degree_e", 'X'},
                                           {"degrees_north", 'Y'},
                                           {"degree_north", 'Y'},
                                           {"degrees_n", 'Y'},
                                           {"degree_n", 'Y'},
                                           {"pa", 'Z'},
                                           {"hpa", 'Z'},
                                           {"mbar", 'Z'},
                                           {"millibar", 'Z'}}};
constexpr std::array<CfWord, 24> kCfNames{{{"time", 'T'},
                                           {"longitude", 'X'},
                                           {"grid_longitude", 'X'},
                                           {"projection_x_coordinate", 'X'},
                                           {"latitude", 'Y'},
                                           {"grid_latitude", 'Y'},
                                           {"projection_y_coordinate", 'Y'},
                                           {"height", 'Z'},
                                           {"altitude", 'Z'},
                                           {"depth", 'Z'},
                                           {"air_pressure", 'Z'},
                                           {"model_level_number", 'Z'},
                                           {"geopotential_height", 'Z'},
                                           {"lon", 'X'},
                                           {"lons", 'X'},
                                           {"west_east", 'X'},
                                           {"lat", 'Y'},
                                           {"lats", 'Y'},
                                           {"south_north", 'Y'},
                                           {"lev", 'Z'},
                                           {"level", 'Z'},
                                           {"plev", 'Z'},
                                           {"bottom_top", 'Z'},
                                           {"elevation", 'Z'}}};

template <std::size_t kCount>
char CfLetterIn(const std::array<CfWord, kCount>& words, const std::string& text) {
  const std::string lower = absl::AsciiStrToLower(text);
  const auto* const found = std::find_if(words.begin(), words.end(),
                                         [&](const CfWord& word) { return lower == word.text; });
  return found == words.end() ? '?' : found->letter;
}

bool IsDown(const CfAxis& axis, char letter) {
  return letter == 'Z' && absl::EqualsIgnoreCase(axis.positive, "down");
}

struct LengthUnit {
  const char* text;
  double metres;
};
constexpr std::array<LengthUnit, 21> kLengthUnits{{{"m", 1},
                                                   {"meter", 1},
                                                   {"meters", 1},
                                                   {"metre", 1},
                                                   {"metres", 1},
                                                   {"km", 1e3},
                                                   {"kilometer", 1e3},
                                                   {"kilometers", 1e3},
                                                   {"kilometre", 1e3},
                                                   {"kilometres", 1e3},
                                                   {"cm", 1e-2},
                                                   {"mm", 1e-3},
                                                   {"millimeter", 1e-3},
                                                   {"millimeters", 1e-3},
                                                   {"millimetre", 1e-3},
                                                   {"millimetres", 1e-3},
                                                   {"um", 1e-6},
                                                   {"micron", 1e-6},
                                                   {"micrometer", 1e-6},
                                                   {"micrometers", 1e-6},
                                                   {"nm", 1e-9}}};

// 0 if the unit is none of length.
double MetresOf(const std::string& unit) {
  const auto* const found =
      std::find_if(kLengthUnits.begin(), kLengthUnits.end(),
                   [&](const LengthUnit& known) { return unit == known.text; });
  return found == kLengthUnits.end() ? 0 : found->metres;
}

// Whether the axes have several units, all of length.
bool HasSeveralLengths(const std::vector<CfAxis>& axes, const CfRoles& roles) {
  bool is_one = true;
  for (const std::size_t axis : roles.space) {
    if (MetresOf(axes[axis].units) == 0) {
      return false;
    }
    is_one = is_one && axes[axis].units == axes[roles.space[0]].units;
  }
  return !is_one;
}

absl::Status UnevenAxis(const CfAxis& axis, std::size_t worst, double deviation, double step) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "axis \"%s\" is not even: its coordinate %d is %g, %g from where steps of %g put it; "
      "expected even distances; --resample interpolates to them",
      axis.name, worst, axis.values[worst], deviation, step));
}

// The first coordinate and the mean step. INVALID_ARGUMENT: not finite, or no way between them.
struct EvenAxis {
  double first = 0;
  double step = 1;
};

absl::StatusOr<EvenAxis> MeanAxisOf(const CfAxis& axis) {
  const std::vector<double>& values = axis.values;
  if (values.empty()) {
    return EvenAxis{};  // counted from 0
  }
  for (const double value : values) {
    if (!std::isfinite(value)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("axis \"%s\" has the coordinate %g", axis.name, value));
    }
  }
  const EvenAxis even{values.front(),
                      (values.back() - values.front()) / static_cast<double>(values.size() - 1)};
  if (even.step == 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "axis \"%s\" begins and ends at %g; expected ascending or descending coordinates",
        axis.name, even.first));
  }
  return even;
}

// INVALID_ARGUMENT: the axis leaves these steps.
absl::Status CheckEven(const CfAxis& axis, const EvenAxis& even) {
  const std::vector<double>& values = axis.values;
  double largest = 0;
  std::size_t worst = 0;
  double deviation = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    largest = std::max(largest, std::abs(values[i]));
    const double off = values[i] - (even.first + even.step * static_cast<double>(i));
    if (std::abs(off) > std::abs(deviation)) {
      worst = i;
      deviation = off;
    }
  }
  constexpr double kTolerance = 1e-3;
  const double precision = largest * (axis.is_single ? 0x1p-22 : 0x1p-50);
  if (std::abs(deviation) > std::max(kTolerance * std::abs(even.step), precision)) {
    return UnevenAxis(axis, worst, deviation, even.step);
  }
  return absl::OkStatus();
}

// From the first coordinate on, in either direction.
absl::StatusOr<std::vector<double>> DistancesOf(const CfAxis& axis) {
  std::vector<double> distances;
  const double sign = axis.values.back() < axis.values.front() ? -1 : 1;
  for (std::size_t i = 0; i < axis.values.size(); ++i) {
    distances.push_back(sign * (axis.values[i] - axis.values.front()));
    if (i > 0 && !(distances[i] > distances[i - 1])) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "axis \"%s\" has the coordinate %g behind %g; expected coordinates that ascend or "
          "descend from the first to the last",
          axis.name, axis.values[i], axis.values[i - 1]));
    }
  }
  return distances;
}

}  // namespace

char CfLetterOf(const CfAxis& axis) {
  const std::string letter = absl::AsciiStrToUpper(axis.axis);
  if (letter == "T" || letter == "Z" || letter == "Y" || letter == "X") {
    return letter[0];
  }
  if (absl::StrContains(axis.units, " since ")) {
    return 'T';
  }
  const char by_units = CfLetterIn(kCfUnits, axis.units);
  if (by_units == 'X' || by_units == 'Y') {
    return by_units;
  }
  for (const char found :
       {CfLetterIn(kCfNames, axis.standard_name), axis.positive.empty() ? '?' : 'Z', by_units,
        AxisLetterOf(axis.name), CfLetterIn(kCfNames, axis.name)}) {
    if (found != '?') {
      return found;
    }
  }
  return '?';
}

std::optional<CfRoles> CfRolesOf(const std::vector<CfAxis>& axes) {
  std::string letters;
  for (const CfAxis& axis : axes) {
    const char letter = CfLetterOf(axis);
    letters.push_back(letter == '?' && axis.size == 1 ? '-' : letter);
  }
  std::string missing;
  for (const char letter : {'Z', 'Y', 'X'}) {
    if (!absl::StrContains(letters, letter)) {
      missing.push_back(letter);
    }
  }
  if (static_cast<std::size_t>(std::count(letters.begin(), letters.end(), '?')) != missing.size()) {
    return std::nullopt;
  }
  std::size_t next = 0;
  CfRoles roles;
  std::size_t space = 0;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const char letter = letters[i] == '?' ? missing[next++] : letters[i];
    if (letter == '-') {
      continue;
    }
    if (letter == 'T' || letter == 'C') {
      std::optional<std::size_t>& role = letter == 'T' ? roles.time : roles.component;
      if (role.has_value()) {
        return std::nullopt;
      }
      role = i;
    } else if (space == 3 || axes[i].size < 2) {
      return std::nullopt;
    } else {
      roles.space[space] = i;
      roles.letters[space++] = letter;
    }
  }
  std::array<char, 3> sorted = roles.letters;
  std::sort(sorted.begin(), sorted.end());
  return sorted == std::array<char, 3>{'X', 'Y', 'Z'} ? std::optional<CfRoles>(roles)
                                                      : std::nullopt;
}

absl::StatusOr<volume::GridGeometry> CfGridOf(const std::vector<CfAxis>& axes,
                                              const CfRoles& roles) {
  for (const std::size_t axis : roles.space) {
    ISOSCOPE_ASSIGN_OR_RETURN(const EvenAxis even, MeanAxisOf(axes[axis]));
    ISOSCOPE_RETURN_IF_ERROR(CheckEven(axes[axis], even));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const CfUnevenGrid grid, CfUnevenGridOf(axes, roles));
  return grid.geometry;
}

absl::StatusOr<CfUnevenGrid> CfUnevenGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles) {
  const bool to_metres = HasSeveralLengths(axes, roles);
  CfUnevenGrid grid;
  volume::GridGeometry& geometry = grid.geometry;
  for (std::size_t i = 0; i < 3; ++i) {
    const CfAxis& axis = axes[roles.space[i]];
    const char letter = roles.letters[i];
    const std::size_t index = 2 - i;  // the fastest is index x
    const int world = letter - 'X';
    ISOSCOPE_ASSIGN_OR_RETURN(const EvenAxis mean, MeanAxisOf(axis));
    const double scale = to_metres ? MetresOf(axis.units) : 1;
    const double sign = IsDown(axis, letter) ? -1 : 1;
    math::Vec3d direction{0, 0, 0};
    direction[world] = mean.step * sign < 0 ? -1 : 1;
    geometry.sample_dims[static_cast<int>(index)] = axis.size;
    geometry.spacing[static_cast<int>(index)] = std::abs(mean.step) * scale;
    geometry.direction.columns[index] = direction;
    geometry.origin[world] = sign * mean.first * scale;
    if (!CheckEven(axis, mean).ok()) {
      ISOSCOPE_ASSIGN_OR_RETURN(grid.distances[index], DistancesOf(axis));
      for (double& distance : grid.distances[index]) {
        distance *= scale;
      }
    }
  }
  return grid;
}

std::string CfLengthUnit(const std::vector<CfAxis>& axes, const CfRoles& roles) {
  const std::string& unit = axes[roles.space[0]].units;
  const bool is_one = std::all_of(roles.space.begin(), roles.space.end(),
                                  [&](std::size_t axis) { return axes[axis].units == unit; });
  return HasSeveralLengths(axes, roles) ? "m" : is_one ? unit : "";
}

absl::StatusOr<std::vector<double>> CfTimesOf(const CfAxis& axis) {
  std::vector<double> times = axis.values;
  for (std::int64_t i = 0; axis.values.empty() && axis.size > 1 && i < axis.size; ++i) {
    times.push_back(static_cast<double>(i));
  }
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (!std::isfinite(times[i]) || (i > 0 && !(times[i] > times[i - 1]))) {
      return absl::InvalidArgumentError(
          absl::StrFormat("its time axis \"%s\" has %g at index %d, behind %g; expected finite "
                          "numbers that ascend, "
                          "each once",
                          axis.name, times[i], i, i > 0 ? times[i - 1] : times[i]));
    }
  }
  return times;
}

}  // namespace isoscope::source
