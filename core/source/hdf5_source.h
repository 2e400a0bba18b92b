// A dataset of an HDF5 file as a source, read in hyperslabs.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// The two parts of "file.h5:/path/to/dataset"; `dataset` is empty if none is named.
struct Hdf5Path {
  std::string file;
  std::string dataset;

  [[nodiscard]] std::string name() const { return file + ":" + dataset; }
};
// True, with the parts, if the name is that of an HDF5 file (.h5 .hdf5 .he5 .hdf .vtkhdf .ims),
// with or without a dataset.
bool SplitHdf5Path(const std::string& path, Hdf5Path* parts);

// Opens a three-dimensional dataset [z][y][x]. Samples are integers, those of 64 bits as in
// wide_source.h, floats of 16 to 64 bits or h5py's bool, in either byte order. Storage is
// contiguous, chunked, or compressed with the library's filters; further axes of one element are
// left out. Without a name the file must hold exactly one such dataset. The spacing is the
// attribute "element_size_um" (z, y, x) if there is one, else 1.
//
// Keeps the chunks of neighbouring rows, at most 32 MiB of them. Chunks of a larger layer are
// decompressed more than once. NOT_FOUND: no such file or dataset (lists those there are).
// INVALID_ARGUMENT: no HDF5 file; not such a dataset. DATA_LOSS: damaged. All files of a dataset
// (external storage, virtual datasets, links) must exist: NOT_FOUND or DATA_LOSS names the missing
// or short one.
//
// The library crashes on some damaged files: it runs in a child process (walled_source.h).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Dataset(const std::string& path);
// Returns the files of such a dataset (hdf5_storage.h). Errors as above.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5Dataset(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_SOURCE_H_
