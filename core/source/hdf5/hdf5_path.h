// Paths that name an HDF5 file, and a dataset of it.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_PATH_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_PATH_H_

#include <string>
#include <vector>

namespace isoscope::source {

// The two parts of "file.h5:/path/to/dataset"; `dataset` is empty if none is named.
struct Hdf5Path {
  std::string file;
  std::string dataset;

  [[nodiscard]] std::string name() const { return file + ":" + dataset; }
};

// Names that say how an HDF5 file is to be read, as their own formats: in lower case.
const std::vector<std::string>& NetcdfEndings();
const std::vector<std::string>& MincEndings();

// True, with the parts, if the name is that of an HDF5 file (.h5 .hdf5 .he5 .hdf .vtkhdf .ims),
// with or without a dataset; or if the file exists, has the content of one (IsHdf5File), and has
// not the name of a format that is written as HDF5, too: netCDF and MINC.
bool SplitHdf5Path(const std::string& path, Hdf5Path* parts);

// Returns true if a regular file has the signature of HDF5 at byte 0, 512, 1024, 2048, ..., as the
// format allows. Opens no other kind of file, such as a named pipe. False for what can't be read.
bool IsHdf5File(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_PATH_H_
