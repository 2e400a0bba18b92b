// The meaning of an array's axes by the CF conventions (netCDF), and the grid that they span.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_CF_GRID_H_
#define ISOSCOPE_CORE_SOURCE_GRID_CF_GRID_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/axis_distances.h"
#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// An axis of an array, and the attributes of its coordinate variable.
struct CfAxis {
  std::string name;  // of the dimension
  std::int64_t size = 0;
  std::string axis{};
  std::string positive{};
  std::string standard_name{};
  std::string units{};
  std::vector<double> values{};  // its coordinates, NaN: missing; none if it has no such variable
  bool is_single = false;        // the coordinates are stored as 32-bit floats
  // The distance of samples of an axis without coordinates, the first at 0; not set: an index.
  std::optional<double> step = std::nullopt;
  // A sentence for an axis without coordinates: why those of the file can't be read; "" if it has
  // none.
  std::string fault{};
};

// T, C (components, members of an ensemble), Z, Y or X; '?' if nothing says it. In this order
// decide: the attribute axis, units ("days since ...", "degrees_east"), standard_name, positive,
// units of pressure, the name.
char CfLetterOf(const CfAxis& axis);

// The roles of the axes of an array, slowest first.
struct CfRoles {
  // The axes of space in the order of the array: [0] slowest, [2] fastest; 'X', 'Y' or 'Z' each.
  std::array<std::size_t, 3> space{};
  std::array<char, 3> letters{};
  std::optional<std::size_t> time = std::nullopt;
  std::optional<std::size_t> component = std::nullopt;

  friend bool operator==(const CfRoles&, const CfRoles&) = default;
};
// Leaves out axes of one element if nothing tells their meaning, or a longer axis has the same. If
// there are as many unknown axes as Z, Y and X are missing, they are these, the slowest one Z. Not
// set if the array is no volume: an axis of space is missing, has one element or is there twice, or
// more axes are unknown.
std::optional<CfRoles> CfRolesOf(const std::vector<CfAxis>& axes);
// Returns the roles that `letters` give, one letter for each axis, in any order. They are Z, Y and
// X, at most one T and one C, and '-' for an axis of one element. INVALID_ARGUMENT: others; an axis
// of space with one element. The message is to follow a name and a colon.
absl::StatusOr<CfRoles> CfRolesFrom(absl::string_view letters, const std::vector<CfAxis>& axes);

// "time (T, 3), run (?, 4)": the axes of an array that is no volume, with what is known of them.
std::string DescribeCfAxes(const std::vector<CfAxis>& axes);
// Letters for such an array that CfRolesFrom takes: unknown axes are what is missing, in the order
// Z, Y, X, C, T. "" if there are none.
std::string SuggestCfAxes(const std::vector<CfAxis>& axes);

// Returns the grid of the samples as they are stored: index x is the fastest axis. Its directions
// are those of world x, y and z. They are turned around where coordinates descend, and for Z where
// they count down. This is known by `positive`, else by units of pressure, else by the standard
// name, else by a name such as "depth" if no coordinate is negative. Axes without coordinates count
// from 0. Lengths in different units are converted to metres, angles to degrees; axes with other
// units, or none, stay as they are. INVALID_ARGUMENT: coordinates that are not even (names the
// axis, the worst coordinate and its distance from an even one): more than a thousandth of a step,
// and more than their precision; that neither ascend nor descend; missing (NaN), infinite, or all
// equal; a `positive` that is neither up nor down. Also, unless the rules have a spacing: the fault
// of an axis; an axis without coordinates beside one with lengths.
absl::StatusOr<volume::GridGeometry> CfGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles,
                                              const GridRules& rules = {});

// The same grid with uneven axes, for ResampleSource: their spacing is the mean. Errors as
// CfGridOf, but for axes that are not even.
struct CfUnevenGrid {
  volume::GridGeometry geometry{};
  AxisDistances distances{};
};
absl::StatusOr<CfUnevenGrid> CfUnevenGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles,
                                            const GridRules& rules = {});

// The unit of all three axes, "m" if they are different units of length; "" if they have several.
std::string CfLengthUnit(const std::vector<CfAxis>& axes, const CfRoles& roles);

// The coordinates of the time axis; 0, 1, ... without coordinates, none for a single element
// without. INVALID_ARGUMENT: not finite, or not ascending (names both).
absl::StatusOr<std::vector<double>> CfTimesOf(const CfAxis& axis);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_CF_GRID_H_
