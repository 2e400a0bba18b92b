// Tells whether the file of a path was replaced or written.

#ifndef ISOSCOPE_CORE_IO_FILE_STAMP_H_
#define ISOSCOPE_CORE_IO_FILE_STAMP_H_

#include <cstdint>
#include <string>

namespace isoscope::io {

struct FileStamp {
  std::int64_t inode = 0;
  std::int64_t size = 0;
  std::int64_t seconds = 0;  // of the last change, with nanoseconds
  std::int64_t nanoseconds = 0;

  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};

// All 0 if there is no such file.
FileStamp StampOf(const std::string& path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_FILE_STAMP_H_
