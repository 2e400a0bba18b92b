// Tells whether the file of a path was replaced or written.

#ifndef ISOSCOPE_CORE_IO_FILE_STAMP_H_
#define ISOSCOPE_CORE_IO_FILE_STAMP_H_

#include <cstdint>
#include <string>

namespace isoscope::io {

// Since 1970.
struct FileTime {
  std::int64_t seconds = 0;
  std::int64_t nanoseconds = 0;

  friend bool operator==(const FileTime&, const FileTime&) = default;
};

struct FileStamp {
  std::int64_t inode = 0;
  std::int64_t size = 0;
  FileTime modified{};  // last change of the bytes; programs can set it (touch, cp -p, tar)
  FileTime changed{};   // last change of bytes, name or rights; programs can't set it back

  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};

// Returns the stamp of the file that a link leads to. All 0 if there is no such file.
FileStamp StampOf(const std::string& path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_FILE_STAMP_H_
