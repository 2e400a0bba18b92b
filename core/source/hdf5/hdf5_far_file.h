// Mounted files (core/io/mounted_file.h) under the HDF5 library, by a driver of its virtual file layer.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_

#include <string>

#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {

// Opens a file to read it, as H5Fopen does: one that is mounted, or one of the disk. A file that is
// mounted opens no other file of the disk: its links and virtual datasets lead to mounted files alone.
// A read that fails is the library's last error, by the words of its status.
Hdf5Handle OpenHdf5ToRead(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FAR_FILE_H_
