// Our driver of the HDF5 library's virtual file layer (H5FD): it reads files with core/io, and can note
// which bytes the library asks for. For the only thread that calls the library.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_DRIVER_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_DRIVER_H_

#include <vector>

#include "absl/functional/function_ref.h"

#include "core/io/mounted_file.h"
#include "hdf5.h"

namespace isoscope::source {

enum class Hdf5DriverFiles {
  kAll,
  kMounted,  // core/io/mounted_file.h; links from them to files of the disk can't be opened
};

// Returns a file access list with the driver, which only reads. It is the process's, and stays open.
// A read that fails is the library's last error, by the words of its status.
hid_t Hdf5DriverAccess(Hdf5DriverFiles files);

// Calls `read`, which calls H5Dread_chunk. Returns the ranges of raw data that the driver is asked for
// meanwhile, in order. They are not read: `read` gets its room back as it was. All else is read. Other
// calls would leave the library's buffers with bytes that were never read.
std::vector<io::FileRange> NoteRawReads(absl::FunctionRef<void()> read);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_DRIVER_H_
