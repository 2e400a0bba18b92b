// The variables of a netCDF file as fields, its time axis as steps.

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// True if a file begins as netCDF: classic, of 64-bit offsets or data, or netCDF-4, which is HDF5.
bool IsNetcdf(absl::string_view head);

// Opens the variables that are volumes by the CF conventions (cf_grid.h), and lie on one grid: that
// of the variable that `part` names or, without a part, that of the most variables, the first of
// those; fields_elsewhere has the other ones. Among variables with and without a time axis, those
// with one. The library runs in a child
// process, one for each open volume. Values as NetcdfPacking. `axes`: letters as CfRolesFrom takes
// them, in place of what the file says, for all variables of as many axes; "" for none.
//
// INVALID_ARGUMENT: no netCDF file; no volume in it, or the part is none (names its axes, and
// letters for them); an axis that is not even, unless the rules resample; as CfGridOf and
// NetcdfFile::PackingOf; times that do not ascend; more than 100 000 steps; axes that no variable
// has. NOT_FOUND: no such file. DATA_LOSS: damaged.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNetcdfSeries(const std::string& file,
                                                               const std::string& part,
                                                               const GridRules& rules = {},
                                                               const std::string& axes = "");

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SERIES_H_
