// The grid of a VTK ImageData file: extents of points, and the geometry of points or cells.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_GRID_H_
#define ISOSCOPE_CORE_SOURCE_VTI_GRID_H_

#include <array>
#include <cstdint>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid_rules.h"
#include "core/source/vti_header.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// First and last point on x, y and z, both inclusive.
using VtiExtent = std::array<std::int64_t, 6>;

// "0 63 0 63 0 92". INVALID_ARGUMENT: no six numbers of 32 bits. `attribute` is for messages.
absl::StatusOr<VtiExtent> ParseVtiExtent(const std::string& text, const char* attribute,
                                         const std::string& path);

// The extent of all points, which the first piece must have. INVALID_ARGUMENT: malformed numbers;
// several pieces.
absl::StatusOr<VtiExtent> WholeVtiExtent(const VtiHeader& header, const std::string& path);

// The grid of the points of an extent, or of its cells' centres, by Origin, Spacing and Direction
// of the tag ImageData. It need not be a volume: it may have one sample on an axis, or none.
// INVALID_ARGUMENT: texts that are no numbers. A distance of 0 or NaN does not move the origin.
absl::StatusOr<volume::GridGeometry> VtiGridOf(const VtiHeader::Attributes& image,
                                               const VtiExtent& extent, bool is_of_cells,
                                               const std::string& path);

// The grid of the points, or of the cells' centres: one less on each axis, half a spacing further.
// INVALID_ARGUMENT: no ImageData; several pieces; malformed numbers; a grid that is no volume;
// what the rules do not take (TakeGridByRules).
absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path,
                                                 const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_GRID_H_
