// The types of elements of HDF5 datasets: which are samples, and how they are read. Calls the
// library: for the process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_TYPES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_TYPES_H_

#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/adapt/wide_source.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/volume/scalar_type.h"
#include "hdf5.h"

namespace isoscope::source {

// How samples are read: as they are stored, in little-endian order.
struct Hdf5SampleType {
  volume::ScalarType scalar = volume::ScalarType::kUint8;  // of `wide`, its carrier
  std::optional<WideType> wide;
  Hdf5Handle memory_type;
};

// Samples are integers of 8 to 64 bits and IEEE floats of 16, 32 and 64 bits. Enumerations, such as
// h5py's bool, and bit fields are read as the integers in which they are stored. INVALID_ARGUMENT:
// another type, which is named; the message is to follow the dataset's name and a colon.
absl::StatusOr<Hdf5SampleType> Hdf5SampleTypeOf(hid_t dataset);

// Returns true if a dataset without a name is rather of this type: integers of 8 to 32 bits, floats
// of 32 and 64.
bool IsPlainHdf5Type(hid_t dataset);

// "float32", "bool", "texts", "complex numbers of float64", "compounds (a, b)", ...
std::string Hdf5TypeName(hid_t type);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_TYPES_H_
