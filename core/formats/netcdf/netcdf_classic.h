// The length that the header of a classic netCDF file promises. The library reads zeros where such
// a file is cut.

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_CLASSIC_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_CLASSIC_H_

#include <string>

#include "absl/status/status.h"

namespace isoscope::source {

// INVALID_ARGUMENT: the file ends before the last sample of some variable, with both sizes, or
// within its header; a header of more than 16 MiB. OK for files of any other format.
absl::Status CheckClassicNetcdfLength(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_CLASSIC_H_
