#include "core/source/grid/rectilinear_grid.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"

namespace isoscope::source {

absl::StatusOr<CfUnevenGrid> RectilinearGridOf(RectilinearAxes axes, bool is_of_cells,
                                               const GridRules& rules) {
  std::vector<CfAxis> cf_axes;
  for (const std::size_t axis : {2U, 1U, 0U}) {
    std::vector<double> values = std::move(axes.points[axis]);
    const std::size_t points = values.size();
    for (std::size_t i = 0; is_of_cells && i + 1 < points; ++i) {
      values[i] = (values[i] + values[i + 1]) / 2;
    }
    if (is_of_cells && points > 0) {
      values.pop_back();
    }
    if (values.size() < 2) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%d points along %c: an isosurface needs 2 samples on each axis", points, "xyz"[axis]));
    }
    cf_axes.push_back({.name = std::string(1, "xyz"[axis]),
                       .size = static_cast<std::int64_t>(values.size()),
                       .values = std::move(values),
                       .is_single = axes.is_single});
  }
  const CfRoles roles{.space = {0, 1, 2}, .letters = {'Z', 'Y', 'X'}};
  if (rules.resamples) {
    return CfUnevenGridOf(cf_axes, roles);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry, CfGridOf(cf_axes, roles));
  return CfUnevenGrid{.geometry = geometry};
}

}  // namespace isoscope::source
