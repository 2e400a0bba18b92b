// Steps that lie in files of their own must lie on one grid.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_ONE_GRID_H_
#define ISOSCOPE_CORE_SOURCE_GRID_ONE_GRID_H_

#include <string>

#include "absl/status/status.h"

#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// INVALID_ARGUMENT unless `grid` is that of the first step, which lies in the file `first`: says
// both grids, behind `place`, the file and the step in words.
absl::Status CheckOneGrid(const std::string& place, const volume::GridGeometry& grid,
                          const std::string& first, const volume::GridGeometry& first_grid);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_ONE_GRID_H_
