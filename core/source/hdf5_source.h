// A dataset of an HDF5 file as a source, read in hyperslabs.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid_rules.h"
#include "core/source/hdf5_path.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens the only volume of a dataset [z][y][x], as OpenHdf5Series does. Storage is contiguous,
// chunked, or compressed with filters (hdf5_filters.h); further axes of one element are left out.
//
// Keeps the chunks of neighbouring rows, at most 32 MiB of them. Chunks of a larger layer are
// decompressed more than once. DATA_LOSS: damaged. All files of a dataset (external storage,
// virtual datasets, links) must exist: NOT_FOUND or DATA_LOSS names the missing or short one.
// INVALID_ARGUMENT: several steps or components. Otherwise errors as OpenHdf5Series.
//
// The library crashes on some damaged files: it runs in a child process (walled_source.h).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Dataset(const std::string& path,
                                                              const GridRules& rules = {});
// Returns the files of such a dataset (hdf5_storage.h). Errors as above.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5Dataset(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_
