#include "core/formats/netcdf/minc_axis.h"

#include <cmath>
#include <cstddef>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/source/grid/stack_layout.h"

namespace isoscope::source {

absl::Status CheckMincSpacing(const MincAxis& axis) {
  if (absl::StartsWith(absl::StripAsciiWhitespace(axis.spacing), "irregular")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the samples along its axis %s lie at uneven distances (spacing = "
                        "\"irregular\"): resample it (mincresample)",
                        axis.name));
  }
  return absl::OkStatus();
}

absl::Status CheckMincAxis(const MincAxis& axis) {
  ISOSCOPE_RETURN_IF_ERROR(CheckMincSpacing(axis));
  if (!std::isfinite(axis.step) || axis.step == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the step of %s is %g; expected a finite distance of samples other than 0: "
                        "correct it (minc_modify_header)",
                        axis.name, axis.step));
  }
  if (!std::isfinite(axis.start)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the start of %s is %g; expected a finite number: correct it "
                        "(minc_modify_header)",
                        axis.name, axis.start));
  }
  constexpr double kTolerance = 0.01;  // of rounded texts, and far below a wrong scale
  const bool is_vector = axis.cosines.empty() || axis.cosines.size() == 3;
  if (!is_vector || !(std::abs(math::Length(MincDirectionOf(axis)) - 1) <= kTolerance)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the direction_cosines of %s are %s; expected three numbers, a vector of "
                        "length 1: correct them (minc_modify_header)",
                        axis.name, absl::StrJoin(axis.cosines, ", ")));
  }
  return absl::OkStatus();
}

math::Vec3d MincDirectionOf(const MincAxis& axis) {
  math::Vec3d direction{0, 0, 0};
  if (axis.cosines.size() == 3) {
    direction = {axis.cosines[0], axis.cosines[1], axis.cosines[2]};
  } else if (!axis.name.empty() && axis.name[0] >= 'x' && axis.name[0] <= 'z') {
    direction[axis.name[0] - 'x'] = 1;
  }
  return direction;
}

std::string MincUnitOf(const MincAxis& axis) {
  const std::string unit(absl::StripAsciiWhitespace(axis.unit));
  return unit.empty() ? "mm" : unit;
}

absl::StatusOr<double> MincUnitFactor(absl::string_view from, absl::string_view to) {
  if (from == to) {
    return 1;
  }
  const std::optional<LengthUnit> unit = LengthUnitOf(from);
  const std::optional<LengthUnit> wanted = LengthUnitOf(to);
  if (!unit.has_value() || !wanted.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("axes of space in \"%s\" and \"%s\"; expected one unit, or units of length",
                        base::Printable(to), base::Printable(from)));
  }
  return unit->metres / wanted->metres;
}

absl::Status CheckMincNumbers(absl::string_view name, const std::vector<double>& numbers) {
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (!std::isfinite(numbers[i])) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "its %s has %g at index %d, and scales samples; expected finite numbers: correct it",
          name, numbers[i], i));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
