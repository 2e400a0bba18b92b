// MINC 1, by the netCDF library.

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_MINC1_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_MINC1_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// Returns true if a file begins as classic netCDF, which MINC 1 is.
bool IsMinc1(absl::string_view head);

// Opens a MINC 1 file as one field of that name, its time axis as steps. The library runs in a
// child process. Values are the real ones, in LPS: float32 if that holds every stored value, else
// float64; those that are stored without a scale keep their type. The length unit is that of the
// axes, or millimetres. INVALID_ARGUMENT: no "image" with axes xspace, yspace and zspace; vectors;
// as CheckMincAxis; a scale of samples that is not finite; a file that is cut. DATA_LOSS: as
// OpenWalledSeries.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMinc1Series(const std::string& path,
                                                              const std::string& field);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_MINC1_SERIES_H_
