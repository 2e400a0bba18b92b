// The grid of a VTK ImageData file: extents of points, and the geometry of points or cells.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTI_GRID_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTI_GRID_H_

#include <array>
#include <cstdint>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vti_header.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/grid/vtk_extent.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// The extent of all points, which the first piece must have. INVALID_ARGUMENT: malformed numbers;
// several pieces.
absl::StatusOr<VtkExtent> WholeVtiExtent(const VtiHeader& header, const std::string& path);

// The grid of the points, or of the cells' centres: one less on each axis, half a spacing further.
// INVALID_ARGUMENT: no ImageData; several pieces; malformed numbers; a grid that is no volume;
// what the rules do not take (TakeGridByRules).
absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path,
                                                 const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTI_GRID_H_
