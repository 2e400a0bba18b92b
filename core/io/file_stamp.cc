#include "core/io/file_stamp.h"

#include <sys/stat.h>

namespace isoscope::io {

FileStamp StampOf(const std::string& path) {
  struct stat found {};
  if (stat(path.c_str(), &found) != 0) {
    return {};
  }
  return {.inode = static_cast<std::int64_t>(found.st_ino),
          .size = static_cast<std::int64_t>(found.st_size),
          .seconds = static_cast<std::int64_t>(found.st_mtim.tv_sec),
          .nanoseconds = static_cast<std::int64_t>(found.st_mtim.tv_nsec)};
}

}  // namespace isoscope::io
