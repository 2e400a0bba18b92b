#include "core/io/file_stamp.h"

#include <sys/stat.h>

namespace isoscope::io {
namespace {

FileTime TimeOf(const timespec& time) {
  return {.seconds = std::int64_t{time.tv_sec}, .nanoseconds = std::int64_t{time.tv_nsec}};
}

}  // namespace

FileStamp StampOf(const std::string& path) {
  struct stat found {};
  if (stat(path.c_str(), &found) != 0) {
    return {};
  }
  return {.inode = static_cast<std::int64_t>(found.st_ino),
          .size = static_cast<std::int64_t>(found.st_size),
          .modified = TimeOf(found.st_mtim),
          .changed = TimeOf(found.st_ctim)};
}

}  // namespace isoscope::io
