// A lock that a process holds on a file, and that ends with the process.

#ifndef ISOSCOPE_CORE_IO_FILE_LOCK_H_
#define ISOSCOPE_CORE_IO_FILE_LOCK_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace isoscope::io {

// Thread-compatible.
class FileLock {
 public:
  // Makes the file if there is none, and locks it without waiting. The lock is sure to be on the
  // file that has this name. FAILED_PRECONDITION: another process holds it. Other errors as
  // CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<FileLock>> Take(const std::string& path);
  // Releases the lock; the file stays.
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  explicit FileLock(int descriptor) : descriptor_(descriptor) {}

  const int descriptor_;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_FILE_LOCK_H_
