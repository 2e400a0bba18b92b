// The filters of chunks that compress datasets of HDF5 files. Calls the library: for the process
// that it runs in (walled_source.h).
//
// A filter of others is code that the library loads from a folder of plugins when it meets the
// filter's number in a file. So only the folder of the system is looked at: neither the one that
// HDF5_PLUGIN_PATH names, nor a relative one. ISOSCOPE_HDF5_PLUGIN_PATH adds folders, whose paths
// are absolute, with ':' between them.

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILTERS_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILTERS_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace isoscope::source {

// Sets the folders of plugins. The first call of a process counts.
void PrepareHdf5Filters();

// `dataset` is a hid_t, without the library's header, which ITK's does not agree with.
// INVALID_ARGUMENT if the dataset is compressed by a filter that is not installed: its number, its
// name, and Debian's package if there is one. The message is to follow a name and a colon.
absl::Status CheckHdf5Filters(std::int64_t dataset);

// The same for a filter by its number. The second function returns the error alone.
absl::Status CheckHdf5Filter(unsigned int id);
absl::Status MissingHdf5Filter(unsigned int id);

// "gzip", "bitshuffle, missing": the filters of a dataset but for those that only reorder or check
// bytes. "" if there are none.
std::string DescribeHdf5Filters(std::int64_t dataset);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILTERS_H_
