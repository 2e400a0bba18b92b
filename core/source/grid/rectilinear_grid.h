// The grid of samples at the crossings of planes: VTK's rectilinear grids.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_RECTILINEAR_GRID_H_
#define ISOSCOPE_CORE_SOURCE_GRID_RECTILINEAR_GRID_H_

#include <array>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/cf_grid.h"
#include "core/source/grid/grid_rules.h"

namespace isoscope::source {

// The coordinates of the points along x, y and z.
struct RectilinearAxes {
  std::array<std::vector<double>, 3> points{};
  bool is_single = false;  // stored as 32-bit floats
};

// The grid of the points, or of the cells' centres, with distances only if it is uneven and the
// rules resample. INVALID_ARGUMENT: fewer than two samples on an axis; uneven (CfGridOf), unless
// the rules resample; coordinates that neither ascend nor descend.
absl::StatusOr<CfUnevenGrid> RectilinearGridOf(RectilinearAxes axes, bool is_of_cells,
                                               const GridRules& rules);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_RECTILINEAR_GRID_H_
