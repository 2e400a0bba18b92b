// Source: CF Metadata Conventions 1.10, chapters 4 (coordinate types) and 5 (coordinate systems),
// https://cfconventions.org.

#include "core/source/grid/cf_grid.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/source/grid/cf_words.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

// Returns true if the name of an axis says that its coordinates are depths: counted down, unless
// negative.
bool IsCfDepth(const CfAxis& axis) {
  return absl::StartsWith(absl::AsciiStrToLower(axis.name), "depth") && !axis.values.empty() &&
         (axis.units.empty() || MetresOfCfUnit(axis.units) != 0) &&
         *std::min_element(axis.values.begin(), axis.values.end()) >= 0;
}

// Returns true if a larger coordinate is lower in the world.
absl::StatusOr<bool> IsCfDown(const CfAxis& axis, char letter) {
  if (letter != 'Z') {
    return false;
  }
  const absl::string_view positive = absl::StripAsciiWhitespace(axis.positive);
  if (!positive.empty()) {
    const bool is_down = absl::EqualsIgnoreCase(positive, "down");
    if (!is_down && !absl::EqualsIgnoreCase(positive, "up")) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "axis \"%s\" has positive = \"%s\"; expected \"up\" or \"down\": correct the attribute",
          axis.name, base::Printable(positive.substr(0, 40))));
    }
    return is_down;
  }
  for (const CfDirection direction :
       {CfDirectionOfUnits(axis.units), CfDirectionOfStandardName(axis.standard_name)}) {
    if (direction != CfDirection::kUnknown) {
      return direction == CfDirection::kDown;
    }
  }
  return IsCfDepth(axis);
}

// Returns the factors that turn the axes of space to one unit, where there are several: lengths
// become metres, angles become degrees. 1 for other axes.
std::array<double, 3> UnitFactorsOf(const std::vector<CfAxis>& axes, const CfRoles& roles) {
  std::array<double, 3> factors{1, 1, 1};
  for (double (*const measure)(absl::string_view) : {&MetresOfCfUnit, &DegreesOfCfUnit}) {
    std::array<double, 3> sizes{};
    std::optional<std::string> unit;
    bool is_one = true;
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const CfAxis& axis = axes[roles.space[i]];
      const std::string& own = axis.units;
      const bool is_index = axis.values.empty() && !axis.step.has_value();
      sizes[i] = is_index ? 0 : measure(own);
      if (sizes[i] != 0) {
        is_one = is_one && unit.value_or(own) == own;
        unit = own;
      }
    }
    for (std::size_t i = 0; i < sizes.size() && !is_one; ++i) {
      factors[i] = sizes[i] != 0 ? sizes[i] : factors[i];
    }
  }
  return factors;
}

// INVALID_ARGUMENT: the file does not tell all distances, but some.
absl::Status CheckGiven(const std::vector<CfAxis>& axes, const CfRoles& roles,
                        const GridRules& rules) {
  if (rules.has_spacing) {
    return absl::OkStatus();
  }
  const CfAxis* length = nullptr;
  const CfAxis* index = nullptr;
  const CfAxis* unitless = nullptr;
  std::set<std::string> lengths;
  const auto name = [&](const CfAxis* axis) {
    const auto place = static_cast<std::size_t>(axis - axes.data());
    std::string letter = "?";
    for (std::size_t i = 0; i < roles.space.size(); ++i) {
      letter = roles.space[i] == place ? std::string(1, roles.letters[i]) : letter;
    }
    return axis->name.empty() ? letter : base::Printable(axis->name);
  };
  for (const std::size_t place : roles.space) {
    const CfAxis& axis = axes[place];
    if (!axis.fault.empty()) {
      return absl::InvalidArgumentError(axis.fault);
    }
    if (axis.values.empty() && !axis.step.has_value()) {
      index = &axis;
    } else if (MetresOfCfUnit(axis.units) != 0) {
      length = &axis;
      lengths.insert(axis.units);
    } else if (axis.units.empty()) {
      unitless = &axis;
    }
  }
  if (lengths.size() > 1 && unitless != nullptr) {  // its coordinates may be in any of them
    return NoSampleDistance(
        "", absl::StrFormat("axes have coordinates in %s, and axis \"%s\" has some without a unit",
                            base::Printable(absl::StrJoin(lengths, " and ")), name(unitless)));
  }
  return length == nullptr || index == nullptr
             ? absl::OkStatus()
             : NoSampleDistance(
                   "", absl::StrFormat("axis \"%s\" has coordinates in %s, and axis "
                                       "\"%s\" has none",
                                       name(length), base::Printable(length->units), name(index)));
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
    return EvenAxis{.first = 0, .step = axis.step.value_or(1)};
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "axis \"%s\": its coordinate %d of %d is %s; expected finite numbers, one a sample",
          axis.name, i, values.size(),
          std::isnan(values[i]) ? "missing" : absl::StrFormat("%g", values[i])));
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

// Returns the distances from the first coordinate, in the direction of the first step.
absl::StatusOr<std::vector<double>> DistancesOf(const CfAxis& axis) {
  std::vector<double> distances;
  const double sign = axis.values[1] < axis.values[0] ? -1 : 1;
  for (std::size_t i = 0; i < axis.values.size(); ++i) {
    distances.push_back(sign * (axis.values[i] - axis.values.front()));
    if (i > 0 && !(distances[i] > distances[i - 1])) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "axis \"%s\" has the coordinate %g behind %g, its coordinate %d of %d; expected "
          "coordinates that ascend or descend from the first to the last: write them so "
          "(longitudes "
          "go on beyond 360)",
          axis.name, axis.values[i], axis.values[i - 1], i, axis.values.size()));
    }
  }
  return distances;
}

// INVALID_ARGUMENT: the axis leaves these steps, or turns back.
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
    ISOSCOPE_RETURN_IF_ERROR(DistancesOf(axis).status());  // which resampling needs
    return UnevenAxis(axis, worst, deviation, even.step);
  }
  return absl::OkStatus();
}

// A letter for each axis: '?' if it is not known, '-' if the axis is left out.
std::string KnownCfLetters(const std::vector<CfAxis>& axes) {
  std::string letters;
  for (const CfAxis& axis : axes) {
    letters.push_back(CfLetterOf(axis));
  }
  // "height" is the y of an image, and the z of a grid whose y has another name.
  const bool has_z = absl::StrContains(letters, 'Z');
  for (std::size_t i = 0; i < axes.size() && !has_z; ++i) {
    if (letters[i] == 'Y' && axes[i].axis.empty() &&
        absl::EqualsIgnoreCase(axes[i].name, "height") &&
        std::count(letters.begin(), letters.end(), 'Y') > 1) {
      letters[i] = 'Z';
      break;
    }
  }
  const std::string all = letters;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    bool is_other = letters[i] == '?';  // or another axis has this meaning
    for (std::size_t k = 0; k < axes.size(); ++k) {
      is_other = is_other || (all[k] == all[i] && (axes[k].size > 1 || k < i));
    }
    if (axes[i].size == 1 && is_other) {
      letters[i] = '-';
    }
  }
  return letters;
}

// Those of Z, Y and X, in this order, that are not among the letters.
std::string MissingCfLetters(const std::string& letters) {
  std::string missing;
  for (const char letter : {'Z', 'Y', 'X'}) {
    if (!absl::StrContains(letters, letter)) {
      missing.push_back(letter);
    }
  }
  return missing;
}

// Not set if they make no volume. REQUIRES: one letter for each axis.
std::optional<CfRoles> CfRolesOfLetters(absl::string_view letters,
                                        const std::vector<CfAxis>& axes) {
  CfRoles roles;
  std::size_t space = 0;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const char letter = letters[i];
    if (letter == '-') {
      if (axes[i].size != 1) {
        return std::nullopt;
      }
    } else if (letter == 'T' || letter == 'C') {
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

}  // namespace

char CfLetterOf(const CfAxis& axis) {
  const std::string letter = absl::AsciiStrToUpper(absl::StripAsciiWhitespace(axis.axis));
  if (letter == "T" || letter == "Z" || letter == "Y" || letter == "X") {
    return letter[0];
  }
  const char by_units = CfLetterOfUnits(axis.units);
  if (by_units != 'Z' && by_units != '?') {
    return by_units;
  }
  for (const char found :
       {CfLetterOfStandardName(axis.standard_name), axis.positive.empty() ? '?' : 'Z', by_units,
        CfLetterOfDimension(axis.name)}) {
    if (found != '?') {
      return found;
    }
  }
  return '?';
}

std::optional<CfRoles> CfRolesOf(const std::vector<CfAxis>& axes) {
  std::string letters = KnownCfLetters(axes);
  std::string missing = MissingCfLetters(letters);
  if (static_cast<std::size_t>(std::count(letters.begin(), letters.end(), '?')) != missing.size()) {
    return std::nullopt;
  }
  std::size_t next = 0;
  for (char& letter : letters) {
    letter = letter == '?' ? missing[next++] : letter;
  }
  return CfRolesOfLetters(letters, axes);
}

absl::StatusOr<CfRoles> CfRolesFrom(absl::string_view letters, const std::vector<CfAxis>& axes) {
  const std::optional<CfRoles> roles =
      letters.size() == axes.size() ? CfRolesOfLetters(letters, axes) : std::nullopt;
  if (!roles.has_value()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "--axes %s: expected one letter for each of its axes %s: Z, Y and X for three of 2 samples "
        "or more, T (time) and C (components) once at most, - for one of 1 element",
        letters, DescribeCfAxes(axes)));
  }
  return *roles;
}

std::string DescribeCfAxes(const std::vector<CfAxis>& axes) {
  return absl::StrJoin(axes, ", ", [](std::string* out, const CfAxis& axis) {
    absl::StrAppendFormat(out, "%s (%c, %d)",
                          axis.name.empty() ? "unnamed" : base::Printable(axis.name),
                          CfLetterOf(axis), axis.size);
  });
}

std::string SuggestCfAxes(const std::vector<CfAxis>& axes) {
  std::string letters = KnownCfLetters(axes);
  for (std::size_t i = 0; i < letters.size(); ++i) {
    if (absl::string_view(letters).substr(0, i).find(letters[i]) != absl::string_view::npos &&
        letters[i] != '-') {
      letters[i] = '?';  // there twice
    }
  }
  std::string missing = MissingCfLetters(letters);
  for (const char letter : {'C', 'T'}) {
    if (!absl::StrContains(letters, letter)) {
      missing.push_back(letter);
    }
  }
  std::size_t next = 0;
  for (char& letter : letters) {
    if (letter == '?' && next < missing.size()) {
      letter = missing[next++];
    }
  }
  return CfRolesOfLetters(letters, axes).has_value() ? letters : "";
}

absl::StatusOr<volume::GridGeometry> CfGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles,
                                              const GridRules& rules) {
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(axes, roles, rules));
  for (const std::size_t axis : roles.space) {
    ISOSCOPE_ASSIGN_OR_RETURN(const EvenAxis even, MeanAxisOf(axes[axis]));
    ISOSCOPE_RETURN_IF_ERROR(CheckEven(axes[axis], even));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const CfUnevenGrid grid, CfUnevenGridOf(axes, roles, rules));
  return grid.geometry;
}

absl::StatusOr<CfUnevenGrid> CfUnevenGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles,
                                            const GridRules& rules) {
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(axes, roles, rules));
  const std::array<double, 3> factors = UnitFactorsOf(axes, roles);
  CfUnevenGrid grid;
  volume::GridGeometry& geometry = grid.geometry;
  for (std::size_t i = 0; i < 3; ++i) {
    const CfAxis& axis = axes[roles.space[i]];
    const char letter = roles.letters[i];
    const std::size_t index = 2 - i;  // the fastest is index x
    const int world = letter - 'X';
    ISOSCOPE_ASSIGN_OR_RETURN(const EvenAxis mean, MeanAxisOf(axis));
    const double scale = factors[i];
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_down, IsCfDown(axis, letter));
    const double sign = is_down ? -1 : 1;
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
  const bool are_lengths =
      std::all_of(roles.space.begin(), roles.space.end(),
                  [&](std::size_t axis) { return MetresOfCfUnit(axes[axis].units) != 0; });
  return is_one ? unit : are_lengths ? "m" : "";
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
