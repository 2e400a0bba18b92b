// The grid of a VTK image, of files in XML and in HDF5: an extent of points, and where they lie.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_VTK_EXTENT_H_
#define ISOSCOPE_CORE_SOURCE_GRID_VTK_EXTENT_H_

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "absl/status/statusor.h"

#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Texts by name, as of the XML tag ImageData.
using VtkAttributes = std::map<std::string, std::string>;

// First and last point on x, y and z, both inclusive.
using VtkExtent = std::array<std::int64_t, 6>;

// "0 63 0 63 0 92". INVALID_ARGUMENT: no six numbers of 32 bits. `attribute` is for messages.
absl::StatusOr<VtkExtent> ParseVtkExtent(const std::string& text, const char* attribute,
                                         const std::string& path);

// The grid of the points of an extent, or of its cells' centres, by Origin, Spacing and Direction
// of the tag ImageData. It need not be a volume: it may have one sample on an axis, or none.
// INVALID_ARGUMENT: texts that are no numbers. A distance of 0 or NaN does not move the origin.
absl::StatusOr<volume::GridGeometry> VtkGridOf(const VtkAttributes& image, const VtkExtent& extent,
                                               bool is_of_cells, const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_VTK_EXTENT_H_
