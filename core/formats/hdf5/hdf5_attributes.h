// Texts and dimension scales of HDF5 objects. Calls the library: for the process that it
// runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_ATTRIBUTES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_ATTRIBUTES_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {

// The texts of an attribute, of one length or of any, 64 at most of 64 KiB at most. None if there
// is no such attribute of texts.
std::vector<std::string> Hdf5Texts(hid_t object, const char* attribute);
// The first of them that is not empty; "" if there is none.
std::string Hdf5Text(hid_t object, const std::vector<const char*>& attributes);

// The dataset that is the scale of an axis (HDF5 Dimension Scales, netCDF-4); the first one if
// there are several. Not valid if there is none.
Hdf5Handle Hdf5ScaleOf(hid_t dataset, std::size_t axis, std::size_t rank);

// The last part of the name of a scale: "time" of "/fields/time".
std::string Hdf5ScaleName(hid_t scale);

// The numbers of the scale of an axis; none if it has no scale, or one without numbers.
// INVALID_ARGUMENT: not `count` of them; not finite, or not ascending (names both). The message is
// to follow a name and a colon.
absl::StatusOr<std::vector<double>> Hdf5ScaleValues(hid_t scale, std::int64_t count);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_ATTRIBUTES_H_
