// Checks the axes and the scale of samples of both versions of MINC in one place.

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_MINC_AXIS_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_MINC_AXIS_H_

#include <array>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"

namespace isoscope::source {

// The attributes of a dimension variable; the defaults are those of MINC.
struct MincAxis {
  std::string name{};  // "xspace"
  double start = 0;
  double step = 1;
  bool has_step = false;
  std::string spacing{};          // "irregular": samples at uneven distances
  std::vector<double> cosines{};  // direction_cosines; empty: the axis of the world of that name
  std::string unit{};             // empty: millimetres
};

// INVALID_ARGUMENT: samples at uneven distances. Messages of this file are to follow a name and a
// colon.
absl::Status CheckMincSpacing(const MincAxis& axis);
// The same, of an axis of space. INVALID_ARGUMENT also: a start or step that is no finite number, a
// step of 0; cosines that are no vector of length 1.
absl::Status CheckMincAxis(const MincAxis& axis);
// The direction of the axis. REQUIRES: CheckMincAxis.
math::Vec3d MincDirectionOf(const MincAxis& axis);
// "mm" if the file gives no unit.
std::string MincUnitOf(const MincAxis& axis);
// The factor that turns lengths of one unit to another. INVALID_ARGUMENT: different units, not both
// of length.
absl::StatusOr<double> MincUnitFactor(absl::string_view from, absl::string_view to);

// INVALID_ARGUMENT: a number of valid_range, image-min or image-max (`name`) that is not finite.
absl::Status CheckMincNumbers(absl::string_view name, const std::vector<double>& numbers);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_MINC_AXIS_H_
