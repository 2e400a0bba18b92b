// The first bytes of a file, decoded if gzip compressed them.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_FILE_START_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_FILE_START_H_

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"

namespace isoscope::source {

struct FileStart {
  std::string bytes;
  bool is_gzip = false;
};

// Reads `size` bytes; fewer if the file ends before. Errors as OpenRandomAccessFile and
// InflateReader; CANCELLED if the process was interrupted.
absl::StatusOr<FileStart> ReadFileStart(const std::string& path, std::size_t size);

// Returns true if a file is a gzip stream, whatever its name says. False for what can't be read.
bool IsGzipFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_FILE_START_H_
