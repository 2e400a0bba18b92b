// The files that the samples of an HDF5 dataset lie in.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_STORAGE_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_STORAGE_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "hdf5.h"

namespace isoscope::source {

// Returns all files of `dataset`, each once, as paths from the working directory. They are its own
// file (the target of an external link), the raw files of external storage, and all sources of a
// virtual dataset, recursively. Searches where the library does, its environment variables
// included. `name` is for messages.
//
// The library silently reads fill values if such a file is missing or too short. So each is opened
// here. NOT_FOUND: a file or a source dataset is missing. DATA_LOSS: a raw file is too short.
// INVALID_ARGUMENT: a virtual dataset that is made of itself.
absl::StatusOr<std::vector<std::string>> FindHdf5Files(hid_t dataset, const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_STORAGE_H_
