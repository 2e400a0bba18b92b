// Tells whether the files of a source have changed.

#ifndef ISOSCOPE_CORE_SOURCE_SOURCE_STAMPS_H_
#define ISOSCOPE_CORE_SOURCE_SOURCE_STAMPS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace isoscope::source {

// Resolves links as far as the path exists: it need not be a file ("run.h5:/p", a pattern). An
// address stays as it is.
absl::StatusOr<std::string> ResolvedPath(const std::string& path);

// Returns a text of the files. Each has its path without links, its number on the disk (inode), its
// size, and the times of the last change of its bytes and of its status. The text changes if a file
// is written again or replaced, or if a link or a folder leads to another file. It also changes
// with rights or names of a file, which costs time only.
//
// Clocks of file systems stand still for some milliseconds, those of a FAT disk for two seconds.
// A second change in this time would not show. So if a file has changed that recently, the call
// waits until its clock goes on: later changes show. It waits once, 20 ms at most (FAT: 2 s).
// Pages that a program has mapped and written lately are written back, so that the next write to
// them shows. Only tmpfs never tells of such a write.
// A mounted file (mounted_file.h) has its name, its size and its version.
// NOT_FOUND, PERMISSION_DENIED.
absl::StatusOr<std::string> StampsOf(const std::vector<std::string>& files);

// Returns false if the stamps of some of these may stay as they are though bytes change: objects at
// an address of which nothing tells that. Then stamps that an earlier process took prove nothing.
bool StampsTellAll(const std::vector<std::string>& files);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SOURCE_STAMPS_H_
