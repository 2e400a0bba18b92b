// Mounted files (core/io/mounted_file.h) under the HDF5 library, by a driver of its virtual file layer.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/mounted_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {

// Opens a file to read it, as H5Fopen does: one that is mounted, or one of the disk. A file that is
// mounted opens no other file of the disk by links and virtual datasets. Its external files are of
// the disk: see the functions below. A read that fails is the library's last error, by the words of
// its status.
Hdf5Handle OpenHdf5ToRead(const std::string& path);

// H5Dread of all elements. An error for a dataset of a mounted file whose elements lie in other files,
// or may do so: virtual ones.
herr_t ReadWholeHdf5(hid_t dataset, hid_t type, void* out);
// INVALID_ARGUMENT, with its name: some dataset of a mounted file is such a one. OK for files of the
// disk. Visits all objects: for libraries that choose by themselves what they read.
absl::Status CheckFarHdf5Objects(hid_t file, const std::string& path);

// Bytes of a stored chunk of a dataset of a mounted file, by the coordinates of its first element.
// Not set: none is stored there, or that can't be known.
std::optional<io::FileRange> FindFarHdf5Chunk(hid_t dataset, const hsize_t* first_element);

// Returns the name of a file of this process that begins as HDF5 files do, and for which H5Fopen opens
// the mounted file `path`, whoever calls it: for libraries that open files by name. RESOURCE_EXHAUSTED:
// the system gives none.
absl::StatusOr<std::string> StandInForFarHdf5(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_
