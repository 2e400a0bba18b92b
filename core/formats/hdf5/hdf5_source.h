// A dataset of an HDF5 file as a source, read in hyperslabs.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Returns the files of a dataset (hdf5_storage.h). Errors as OpenHdf5Series.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5Dataset(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_H_
