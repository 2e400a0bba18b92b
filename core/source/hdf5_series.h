// The steps and components of a dataset of an HDF5 file.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens a dataset of three axes or more as one field. The meaning of its axes is `axes`, one letter
// each ("TCZYX", slowest first), if that is not empty; else as OpenHdf5Dataset, if there are three
// or three of more than one element; else as attributes say (hdf5_attributes.h). Times are the
// values of the scale of the time axis, with its attribute "units"; without a scale 0, 1, 2, ...
// The field has the dataset's name, its "long_name" and "units". Besides the types of
// OpenHdf5Dataset: integers of 64 bits and IEEE floats of 16 (wide_source.h), h5py's bool as uint8.
//
// Errors as OpenHdf5Dataset. INVALID_ARGUMENT also: axes that are not said anywhere (lists the
// choices, with the shape); other letters than axes; a time axis of more than 100 000; a scale that
// does not ascend. The library runs in a child process, one for each open volume.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Series(const std::string& path,
                                                             const std::string& axes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_SERIES_H_
