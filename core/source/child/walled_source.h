// A volume whose library runs in a process of its own (decoder_process.h), called the wall here.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SOURCE_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/units.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// The calls of a library for a path, in the process that it runs in. `part` is text of its own that
// names one of the volumes of the path; "" where there is but one.
struct WalledLibrary {
  using Texts = absl::StatusOr<std::vector<std::string>>;
  const char* name = "";  // for messages: "HDF5"
  absl::StatusOr<std::unique_ptr<VolumeSource>> (*open)(const std::string& path,
                                                        const std::string& part) = nullptr;
  Texts (*find_files)(const std::string& path) = nullptr;
  Texts (*describe)(const std::string& path, const std::string& part) = nullptr;  // none empty
  // Address space for all that SourceInfo::memory_bytes does not count.
  std::int64_t memory_bytes = base::kGiB;
};

// Opens the volume by `library.open` in a child process, which then reads the rows, too, and ends
// with the source. Its answers are checked, and its errors are those of `library.open` and
// ReadRows. DATA_LOSS also: the library ended its process, or a limit of processor time or memory
// did. DEADLINE_EXCEEDED: it did not answer. CANCELLED: the process was interrupted. After an error
// of ReadRows all later ones fail. RESOURCE_EXHAUSTED: the system gives no process.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenWalled(const WalledLibrary& library,
                                                         const std::string& path,
                                                         const std::string& part = "");

// `library.find_files` of each path, one after the other, in one child process. Errors as above.
absl::StatusOr<std::vector<std::string>> FindFilesWalled(const WalledLibrary& library,
                                                         const std::vector<std::string>& paths);

// `library.describe`, in a child process; nothing in it that a terminal would obey. Errors as
// above.
absl::StatusOr<std::vector<std::string>> DescribeWalled(const WalledLibrary& library,
                                                        const std::string& path,
                                                        const std::string& part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SOURCE_H_
