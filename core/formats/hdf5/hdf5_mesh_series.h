// The meshes of a VTKHDF or openPMD file as fields, their steps as steps.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens the fields that lie on one grid, that of the most fields, the first of those; or that one
// which `part` names, as in SeriesFile (series_format.h). Null if the file describes no meshes. The
// library runs in a child process. Errors as FindHdf5Meshes and OpenHdf5Series. INVALID_ARGUMENT
// also: a step without the grid of the first (names the dataset), or, of openPMD, without its unit
// (names the attribute with both values); as TakeGridByRules, once a volume is opened.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5MeshSeries(const std::string& file,
                                                                 const std::string& part,
                                                                 const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_SERIES_H_
