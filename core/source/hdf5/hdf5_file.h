// Opening an HDF5 file to read it. Calls the library: for the process that it runs in
// (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {

// For H5Pset_chunk_cache. With 1 the library (1.10) drops only chunks that were read from end to end,
// whatever the bound of its cache: all others would stay.
inline constexpr double kChunkPreemption = 0.75;

// Makes the library ready: it prints no errors, loads filters as PrepareHdf5Filters
// (hdf5_filters.h) says, and follows links as FollowLinksToRegularFiles (hdf5_external_links.h)
// does. Code that opens files by another library that calls HDF5 needs it.
void PrepareHdf5();

// Opens a file. NOT_FOUND: no such file. UNAVAILABLE: locked, or marked as open for writing (says
// what to do). DATA_LOSS: cut. INVALID_ARGUMENT: no HDF5 file (says what it is, if that is known),
// or damaged.
absl::StatusOr<Hdf5Handle> OpenHdf5File(const std::string& path);

// Returns the error of the library about a file that it did not open.
absl::Status Hdf5OpenError(const std::string& path, const std::string& said);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_H_
