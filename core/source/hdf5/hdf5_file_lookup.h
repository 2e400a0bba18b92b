// Where the HDF5 library looks for the other files that a file names. Version 1.10, with the
// prefixes of the environment. Calls the library: for the process that it runs in
// (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_LOOKUP_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_LOOKUP_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include <sys/types.h>

#include "hdf5.h"

namespace isoscope::source {

// The text of a library function that takes a buffer and its size, and returns the length.
template <typename Call>
std::string Hdf5TextFrom(const Call& call) {
  const ssize_t length = call(nullptr, 0);
  if (length <= 0) {
    return "";
  }
  std::string text(static_cast<std::size_t>(length) + 1, '\0');
  call(text.data(), text.size());
  text.resize(static_cast<std::size_t>(length));
  return text;
}

// The file of an object, by the name that it was opened by.
std::string Hdf5FileOf(hid_t object);

// The object that names the other file: an external link, or a virtual dataset.
enum class Hdf5OtherFile { kOfLink, kOfVirtualDataset };
// The paths at which the library looks for a file that `owner` names, in its order
// (H5F_prefix_open_file).
std::vector<std::string> Hdf5PathsOf(Hdf5OtherFile kind, const std::string& file,
                                     const std::string& owner);
// The path of a raw file of external storage (H5D__efl_read).
std::string Hdf5RawFilePath(const std::string& file, const std::string& owner);

// The name of the `i`-th source of a virtual dataset: "%b" is where sources are counted, "%%" is
// "%" (H5Pset_virtual). Sets `is_numbered` if there is a "%b".
std::string Hdf5NumberedName(absl::string_view name, std::int64_t i, bool* is_numbered);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_FILE_LOOKUP_H_
