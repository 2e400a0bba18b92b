// The files that the samples of an HDF5 dataset lie in.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_STORAGE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_STORAGE_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "hdf5.h"

namespace isoscope::source {

// All files that `dataset` is read from: its own (of an external link, the one that is linked), the
// raw files of external storage, and the sources of a virtual dataset with what these are made of.
// Each once, as paths from where the process runs. Looks where the library looks, its environment
// variables among it. `name` is for messages.
//
// The library reads fill values where such a file is missing or too short, and says nothing; so
// each is opened here. NOT_FOUND: a file or a source dataset is missing. DATA_LOSS: a raw file is
// too short. INVALID_ARGUMENT: a virtual dataset that is made of itself.
absl::StatusOr<std::vector<std::string>> FindHdf5Files(hid_t dataset, const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_STORAGE_H_
