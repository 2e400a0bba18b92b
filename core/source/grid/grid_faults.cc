#include "core/source/grid/grid_faults.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"

#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

std::string Prefix(absl::string_view path) { return path.empty() ? "" : absl::StrCat(path, ": "); }

std::string NumbersOf(const math::Vec3d& v) { return absl::StrFormat("%g, %g, %g", v.x, v.y, v.z); }

}  // namespace

absl::Status GridFaults::Check(const GridRules& rules, absl::string_view path) const {
  std::string message;
  const auto add = [&](const absl::Status& fault, bool is_given) {
    if (!fault.ok() && !is_given) {
      absl::StrAppend(&message, message.empty() ? Prefix(path) : "; and ",
                      absl::StripPrefix(fault.message(), Prefix(path)));
    }
  };
  add(distances, rules.has_spacing);
  add(directions, rules.has_direction);
  add(origin, rules.has_origin);
  return message.empty() ? absl::OkStatus() : absl::InvalidArgumentError(message);
}

absl::Status NoDirections(absl::string_view path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(
      Prefix(path), what,
      "; expected finite, independent directions of the axes: give them in place of "
      "those of the file, --direction XX,XY,XZ,YX,... (1,0,0,0,1,0,0,0,1: x, y and z)"));
}

absl::Status NoOrigin(absl::string_view path, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat(Prefix(path), what,
                   "; expected finite numbers: give the place of the first sample in place of that "
                   "of the file, --origin X,Y,Z"));
}

void ReplaceFaults(absl::string_view path, volume::GridGeometry* grid, GridFaults* faults) {
  math::Vec3d& spacing = grid->spacing;
  if (!math::IsFinite(spacing) || !(spacing.x > 0 && spacing.y > 0 && spacing.z > 0)) {
    faults->distances.Update(NoSampleDistance(path, absl::StrCat("spacing ", NumbersOf(spacing))));
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_good = std::isfinite(spacing[axis]) && spacing[axis] > 0;
      spacing[axis] = is_good ? spacing[axis] : 1;
    }
  }
  constexpr double kDependent = 1e-6;  // as in volume::Validate
  if (const double determinant = math::Determinant(grid->direction);
      !std::isfinite(determinant) || std::abs(determinant) < kDependent) {
    const auto& [x, y, z] = grid->direction.columns;
    faults->directions.Update(
        NoDirections(path, absl::StrCat("directions (", NumbersOf(x), "), (", NumbersOf(y),
                                        ") and (", NumbersOf(z), ")")));
    grid->direction = math::Mat3d();
  }
  if (!math::IsFinite(grid->origin)) {
    faults->origin.Update(NoOrigin(path, absl::StrCat("origin ", NumbersOf(grid->origin))));
    grid->origin = {0, 0, 0};
  }
}

absl::Status TakeGridByRules(absl::string_view path, const GridRules& rules,
                             volume::GridGeometry* grid) {
  GridFaults faults;
  ReplaceFaults(path, grid, &faults);
  return faults.Check(rules, path);
}

}  // namespace isoscope::source
