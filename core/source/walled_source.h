// A volume whose library runs in a process of its own (decoder_process.h), called the wall here.

#ifndef ISOSCOPE_CORE_SOURCE_WALLED_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_WALLED_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// The functions of a library on a path. They run in the child process.
struct WalledLibrary {
  const char* name = "";  // for messages: "HDF5"
  absl::StatusOr<std::unique_ptr<VolumeSource>> (*open)(const std::string& path) = nullptr;
  absl::StatusOr<std::vector<std::string>> (*find_files)(const std::string& path) = nullptr;
};

// Opens the volume by `library.open` in a child process, which then reads the rows, too, and ends
// with the source. Its answers are checked, and its errors are those of `library.open` and
// ReadRows. DATA_LOSS also: the library ended its process, or took too long. After an error of
// ReadRows all later ones fail. RESOURCE_EXHAUSTED: the system gives no process.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenWalled(const WalledLibrary& library,
                                                         const std::string& path);

// `library.find_files`, in a child process. Errors as above.
absl::StatusOr<std::vector<std::string>> FindFilesWalled(const WalledLibrary& library,
                                                         const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_WALLED_SOURCE_H_
