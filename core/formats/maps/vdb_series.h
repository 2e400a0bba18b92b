// OpenVDB: each grid as a field.

#ifndef ISOSCOPE_CORE_FORMATS_MAPS_VDB_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_MAPS_VDB_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Returns true if a file begins as OpenVDB does.
bool IsVdb(absl::string_view head);

// Opens the grids of an OpenVDB file by libopenvdb, which runs in a child process. A grid gives the
// box of its active voxels, filled densely: inactive voxels have their value. Float and double keep
// their type, also if the file has them as half; int32 too; int64 becomes float64; bool and masks
// become uint8, 0 or 1; vectors have the components x, y and z. The long name of a field is the
// class of its grid.
//
// A `part` (SeriesFile) chooses a grid. Without it, the fields are the grids of the transform that
// most of them have. Each field has the box around the active voxels of all of them, so that one
// dataset can hold them. A grid without a name has that of the file. INVALID_ARGUMENT: no such grid
// that can be read (names their types); of Open: no active voxel; a transform that is not linear; a
// shear, unless the rules ignore it; a box of more than 1 TiB. FAILED_PRECONDITION: isoscope_vdb.so
// can't be loaded. Otherwise as OpenWalledSeries.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVdbSeries(const std::string& file,
                                                            const std::string& part,
                                                            const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MAPS_VDB_SERIES_H_
