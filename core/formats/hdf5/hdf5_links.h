// All files that decide what a name in an HDF5 file leads to. netCDF-4 and MINC 2 are such files.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LINKS_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LINKS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace isoscope::source {

// Returns the file, then the files that it needs, each once, as paths from the working directory.
// External links on the way to `object` and below it name them, or they hold samples of virtual
// datasets and of external storage. `object` is a group, with all below it, or a dataset, with the
// scales of its axes; "/" is the whole file.
//
// Takes all paths at which the library looks, if something is there; a file that is missing is left
// out, as whoever opens it reports it. A file that is no HDF5 file is returned alone. Calls the
// library: for the process that it runs in (walled_source.h).
std::vector<std::string> FindHdf5LinkedFiles(const std::string& file, const std::string& object);

// The same of whole files, one after the other, in a child process. Errors as FindFilesWalled.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5Trees(const std::vector<std::string>& files);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LINKS_H_
