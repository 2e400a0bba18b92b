// Opens MINC 2 by ITK and libminc, and MINC 1 by minc1_series.h.

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_MINC_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_MINC_SOURCE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens a MINC 2 file, which is HDF5, as one field of that name. The libraries run in a child
// process, which reads a plane at a time. Values are the real ones, in LPS. A classic netCDF file
// is MINC 1. INVALID_ARGUMENT: not a MINC file; of MINC 2 time or vectors; sheared directions; as
// CheckMinc2Header and OpenMinc1Series. DATA_LOSS: as OpenWalled.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMincSeries(const std::string& path,
                                                             const std::string& field);

// MINC 2 in this process, which the libraries may end.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMincFile(const std::string& path,
                                                           const std::string& part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_MINC_SOURCE_H_
