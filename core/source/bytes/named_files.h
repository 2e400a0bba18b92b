// The files that a folder or a pattern names.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_NAMED_FILES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_NAMED_FILES_H_

#include <string>
#include <vector>

#include "absl/status/status.h"

namespace isoscope::source {

// Returns the files in a folder, or those of a pattern with '*', '?' or '[' in it, or the file
// itself. It leaves out folders and paths that are not `is_wanted`. "slice9" comes before "slice10"
// (natural_order.h).
std::vector<std::string> FilesNamed(const std::string& path,
                                    bool (*is_wanted)(const std::string& path));

// NOT_FOUND: nothing there. INVALID_ARGUMENT: a folder, or a pointer of Git LFS. Otherwise as io::CheckIsRegularFile.
absl::Status CheckIsFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_NAMED_FILES_H_
