// The meaning of an array's axes by the CF conventions (netCDF), and the grid that they span.

#ifndef ISOSCOPE_CORE_SOURCE_CF_GRID_H_
#define ISOSCOPE_CORE_SOURCE_CF_GRID_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/resampled_source.h"
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
  std::vector<double> values{};  // its coordinates; none if it has no such variable
  bool is_single = false;        // the coordinates are stored as 32-bit floats
};

// T, C (components), Z, Y or X; '?' if nothing says it. In this order decide: the attribute axis,
// units ("days since ...", "degrees_east"), standard_name, positive, units of pressure, the name.
char CfLetterOf(const CfAxis& axis);

// Which axes of an array, slowest first, are which.
struct CfRoles {
  // The axes of space in the order of the array: [0] slowest, [2] fastest; 'X', 'Y' or 'Z' each.
  std::array<std::size_t, 3> space{};
  std::array<char, 3> letters{};
  std::optional<std::size_t> time = std::nullopt;
  std::optional<std::size_t> component = std::nullopt;

  friend bool operator==(const CfRoles&, const CfRoles&) = default;
};
// Axes of one element without a meaning are left out; as many unknown ones as Z, Y and X miss are
// these, the slowest Z. Not set if the array is no volume: an axis of space is missing, has one
// element or is there twice, or more axes are unknown.
std::optional<CfRoles> CfRolesOf(const std::vector<CfAxis>& axes);

// The grid of the samples as they are stored: index x is the fastest axis. Its directions are those
// of world x, y and z, turned around where coordinates descend, and for Z where positive is "down".
// Axes without coordinates count from 0. INVALID_ARGUMENT: coordinates that are not even (names the
// axis, the worst coordinate and its distance from an even one): more than a thousandth of a step,
// and more than their precision; not finite, or all equal. Axes in different units of length
// (km, m, cm, mm, um, nm) are all converted to metres.
absl::StatusOr<volume::GridGeometry> CfGridOf(const std::vector<CfAxis>& axes,
                                              const CfRoles& roles);

// The same grid with uneven axes, for ResampleSource: their spacing is the mean. INVALID_ARGUMENT:
// coordinates that neither ascend nor descend.
struct CfUnevenGrid {
  volume::GridGeometry geometry{};
  AxisDistances distances{};
};
absl::StatusOr<CfUnevenGrid> CfUnevenGridOf(const std::vector<CfAxis>& axes, const CfRoles& roles);

// The unit of all three axes, "m" if they are different units of length; "" if they have several.
std::string CfLengthUnit(const std::vector<CfAxis>& axes, const CfRoles& roles);

// The coordinates of the time axis; 0, 1, ... without coordinates, none for a single element
// without. INVALID_ARGUMENT: not finite, or not ascending (names both).
absl::StatusOr<std::vector<double>> CfTimesOf(const CfAxis& axis);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CF_GRID_H_
