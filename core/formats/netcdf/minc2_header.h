// Checks the header of a MINC 2 file, which ITK and libminc do not. With them a step of 0 becomes
// that of another axis, uneven distances become even, and units are passed over. This code calls
// the HDF5 library, so it is for the process in which the library runs (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_MINC2_HEADER_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_MINC2_HEADER_H_

#include <array>
#include <string>

#include "absl/status/statusor.h"

namespace isoscope::source {

// Returns the factor that turns the lengths of each axis, x, y and z, to millimetres; 1 for an axis
// that is not there.
// INVALID_ARGUMENT: as CheckMincAxis; an attribute that is no number; units that are none of
// length; a valid_range, image-min or image-max of integers that is not finite. Otherwise as
// OpenHdf5File. A file that is not laid out as MINC 2 is left to the libraries.
absl::StatusOr<std::array<double, 3>> CheckMinc2Header(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_MINC2_HEADER_H_
