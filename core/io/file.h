// Files: the only place that knows POSIX I/O. They are interfaces, so that tests can inject short
// reads, EIO and ENOSPC (tests/support/fault_file.h).
//
// Every error names the path and the system's reason: NOT_FOUND (no such file or directory),
// PERMISSION_DENIED, ALREADY_EXISTS, RESOURCE_EXHAUSTED (disk or quota full, too many open files),
// DATA_LOSS (EIO; a file shorter than expected), INTERNAL otherwise.

#ifndef ISOSCOPE_CORE_IO_FILE_H_
#define ISOSCOPE_CORE_IO_FILE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::io {

// A file of fixed content, read by position. Thread-safe.
class RandomAccessFile {
 public:
  virtual ~RandomAccessFile() = default;

  // Reads exactly `size` bytes from `offset` into `out`. DATA_LOSS if the file ends before.
  [[nodiscard]] virtual absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                            char* out) const = 0;
  // Reads the bytes from `offset` on that lie in the system's memory without a gap, and returns
  // their number, in [0, size]. Never waits for a disk. After an error it returns less; ReadAt
  // reports the error.
  [[nodiscard]] virtual std::size_t ReadCached(std::int64_t /*offset*/, std::size_t /*size*/,
                                               char* /*out*/) const {
    return 0;
  }
  [[nodiscard]] virtual std::int64_t size_bytes() const = 0;
  [[nodiscard]] virtual const std::string& path() const = 0;
  // Tells the system to read nothing ahead from now on.
  virtual void ExpectScatteredReads() const {}
  // Returns a descriptor for pread; -1 if no descriptor gives these bytes.
  [[nodiscard]] virtual int descriptor() const { return -1; }
};

// A new file. Thread-compatible. Writes are buffered. Bytes are sure to be on disk only after
// Close() has returned OK. The destructor closes without that guarantee. The first error stays:
// every later call returns it.
class WritableFile {
 public:
  virtual ~WritableFile() = default;

  // Writes at size_bytes().
  [[nodiscard]] virtual absl::Status Append(absl::string_view bytes) = 0;
  // Writes at any offset >= 0, in any order, and may write over earlier bytes. Bytes that are never
  // written read as zeros.
  [[nodiscard]] virtual absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) = 0;
  // Flushes to disk (fsync) and closes. Writing after it is FAILED_PRECONDITION; closing again is
  // OK.
  [[nodiscard]] virtual absl::Status Close() = 0;
  // Returns the end of the farthest write, flushed or not.
  [[nodiscard]] virtual std::int64_t size_bytes() const = 0;
};

// FAILED_PRECONDITION, which says what `path` is, if it is there and is no regular file: a folder,
// a FIFO, a socket or a device, whose opening or reading may not end. Never waits for a writer.
absl::Status CheckIsRegularFile(const std::string& path);

// Opens a file, or one that is mounted (mounted_file.h). FAILED_PRECONDITION as CheckIsRegularFile.
absl::StatusOr<std::unique_ptr<RandomAccessFile>> OpenRandomAccessFile(const std::string& path);

// Creates `path`, which must not exist.
absl::StatusOr<std::unique_ptr<WritableFile>> CreateWritableFile(const std::string& path);
// Does the same with a buffer of this size, a power of two. Bytes that are written without a gap go
// to the kernel in parts that begin and end at multiples of the size. The kernel's page cache then
// holds equally large parts, which are faster to read.
absl::StatusOr<std::unique_ptr<WritableFile>> CreateBufferedFile(const std::string& path,
                                                                 std::size_t buffer_bytes);
// Does the same, and whole buffers go to the disk past the page cache (O_DIRECT) where the file
// system can: for files so large that the cache would not keep them. REQUIRES: buffer_bytes is a
// multiple of kDirectAlignment.
inline constexpr std::size_t kDirectAlignment = 4096;
absl::StatusOr<std::unique_ptr<WritableFile>> CreateDirectFile(const std::string& path,
                                                               std::size_t buffer_bytes);

// Reads a whole file of at most `max_size_bytes`; a larger one is INVALID_ARGUMENT.
absl::StatusOr<std::string> ReadWholeFile(const std::string& path, std::int64_t max_size_bytes);
absl::StatusOr<std::string> ReadWholeFile(const RandomAccessFile& file,
                                          std::int64_t max_size_bytes);

// Writes `bytes` to a new file and flushes it; removes it again on an error.
absl::Status WriteWholeFile(const std::string& path, absl::string_view bytes);

// Creates one directory; its parent must exist, it must not.
absl::Status CreateDirectory(const std::string& path);
// Renames within one file system and flushes both parent directories. `to` must not exist, unless
// both are files: then it is replaced in one step.
absl::Status RenamePath(const std::string& from, const std::string& to);
// Flushes a directory's entries to disk.
absl::Status SyncDirectory(const std::string& path);
// Removes a file or a whole directory tree; OK if there is none.
absl::Status RemoveRecursively(const std::string& path);
// Returns the size of all files below a folder. Those that vanish meanwhile do not count.
std::int64_t BytesBelow(const std::string& path);
bool PathExists(const std::string& path);
bool IsDirectory(const std::string& path);

// The errors of ReadAt: DATA_LOSS if the range does not lie within size_bytes(); the error of a
// range that met the file's end at `end`; the error of a range that the system refused.
absl::Status CheckRange(const RandomAccessFile& file, std::int64_t offset, std::size_t size);
absl::Status FileTooShort(const RandomAccessFile& file, std::int64_t offset, std::size_t size,
                          std::int64_t end);
absl::Status ReadFailed(int error_number, const RandomAccessFile& file, std::int64_t offset,
                        std::size_t size);

// Maps errno to a status that names `what` and `path`.
absl::Status ErrnoToStatus(int error_number, absl::string_view what, absl::string_view path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_FILE_H_
