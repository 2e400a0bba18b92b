#include "core/io/file_lock.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

#include "absl/strings/str_cat.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "core/io/file.h"

namespace isoscope::io {
namespace {

// Whoever removes a locked file leaves others with a lock on a file that has no name.
bool HasName(int descriptor, const std::string& path) {
  struct stat held {};
  struct stat named {};
  return fstat(descriptor, &held) == 0 && stat(path.c_str(), &named) == 0 &&
         held.st_dev == named.st_dev && held.st_ino == named.st_ino;
}

}  // namespace

absl::StatusOr<std::unique_ptr<FileLock>> FileLock::Take(const std::string& path) {
  while (true) {
    const int descriptor = open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (descriptor < 0) {
      return ErrnoToStatus(errno, "can't make", path);
    }
    std::unique_ptr<FileLock> lock(new FileLock(descriptor));
    while (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
      if (errno == EWOULDBLOCK) {
        return absl::FailedPreconditionError(
            absl::StrCat(path, ": another process holds this lock"));
      }
      if (errno != EINTR) {
        return ErrnoToStatus(errno, "can't lock", path);
      }
    }
    if (HasName(descriptor, path)) {
      return lock;
    }
  }
}

FileLock::~FileLock() { close(descriptor_); }

}  // namespace isoscope::io
