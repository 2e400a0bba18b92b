// A variable of a netCDF file as a source. Calls the library: for the process that it runs in
// (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SOURCE_H_

#include <cstdint>
#include <memory>

#include "absl/status/statusor.h"

#include "core/formats/netcdf/netcdf_file.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Opens one step and one component of a variable, which then owns the file. Samples have the stored
// type if the packing is plain; else float32 if that holds every stored value, else float64. Keeps
// the chunks of neighbouring rows, at most 32 MiB of them. If the rules resample, the grid is that
// of CfUnevenGridOf. INVALID_ARGUMENT: no grid of a volume; as PackingOf; chunks of more than 256
// MiB. REQUIRES: indices in range, 0 where there is no such axis.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenNetcdfVolume(std::unique_ptr<NetcdfFile> file,
                                                               const NetcdfVariable& variable,
                                                               std::int64_t step,
                                                               std::int64_t component,
                                                               const GridRules& rules = {});

// The same on a grid that is known, of samples as they are stored. REQUIRES: the roles of space
// and the grid have the same sizes.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenStoredNetcdf(std::unique_ptr<NetcdfFile> file,
                                                               const NetcdfVariable& variable,
                                                               const volume::GridGeometry& geometry,
                                                               std::int64_t step);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_SOURCE_H_
