// Files by POSIX calls, in three parts:
//
// 1. PosixRandomAccessFile reads with pread, and with preadv2(RWF_NOWAIT) for bytes in memory.
// 2. PosixWritableFile buffers one stretch of bytes. It writes up to the last multiple of the
//    buffer's size that the stretch reaches, and keeps the rest. With a second descriptor, whole
//    buffers go past the page cache. The kernel keeps both ways coherent.
// 3. Functions on paths: create, rename, flush, remove.
//
// A name that is mounted (mounted_file.h) goes before a path of the disk.
//
// Invariants: calls that a signal interrupted (EINTR) are repeated. Every error becomes a status
// with the path, by ErrnoToStatus. A new name is on disk only after its directory was flushed.

#include "core/io/file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <new>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include <sys/stat.h>
#include <sys/uio.h>

#include "core/base/check.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/continued_file.h"
#include "core/io/mounted_file.h"
#include "core/io/transfers.h"

namespace isoscope::io {
namespace {

// With a buffer of this size, a write costs more than its system call.
constexpr std::size_t kWriteBufferBytes = 256 * static_cast<std::size_t>(base::kKiB);

// An interrupted process may wait this long for a disk that removes its files.
constexpr absl::Duration kMaxRemovalDuration = absl::Seconds(30);

// An open file descriptor, closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) {
      close(fd_);
    }
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;

  [[nodiscard]] int get() const { return fd_; }
  // Closes and returns 0 or the errno. The descriptor is gone even after an error.
  int Close() { return close(std::exchange(fd_, -1)) == 0 ? 0 : errno; }

 private:
  int fd_;
};

absl::StatusOr<Descriptor> OpenDescriptor(const std::string& path, int flags, mode_t mode,
                                          absl::string_view what) {
  int fd = -1;
  do {
    fd = open(path.c_str(), flags | O_CLOEXEC, mode);
  } while (fd < 0 && errno == EINTR);
  if (fd < 0) {
    return ErrnoToStatus(errno, what, path);
  }
  return Descriptor(fd);
}

absl::Status Sync(int fd, const std::string& path) {
  int result = 0;
  do {
    result = fsync(fd);
  } while (result != 0 && errno == EINTR);
  return result == 0 ? absl::OkStatus() : ErrnoToStatus(errno, "flush", path);
}

std::string ParentOf(const std::string& path) {
  std::filesystem::path trimmed(path);
  if (!trimmed.has_filename()) {
    trimmed = trimmed.parent_path();
  }
  const std::filesystem::path parent = trimmed.parent_path();
  return parent.empty() ? "." : parent.string();
}

// OK for a regular file.
absl::Status CheckMode(mode_t mode, const std::string& path) {
  if (S_ISREG(mode)) {
    return absl::OkStatus();
  }
  const char* const kind = S_ISDIR(mode)    ? "a directory"
                           : S_ISFIFO(mode) ? "a pipe (FIFO)"
                           : S_ISSOCK(mode) ? "a socket"
                                            : "a device";
  return absl::FailedPreconditionError(
      absl::StrCat(path, ": is ", kind, ", expected a regular file",
                   S_ISFIFO(mode) ? "; write what comes out of it to a file first" : ""));
}

class PosixRandomAccessFile : public RandomAccessFile {
 public:
  PosixRandomAccessFile(Descriptor descriptor, std::int64_t size_bytes, std::string path)
      : descriptor_(std::move(descriptor)), size_bytes_(size_bytes), path_(std::move(path)) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(CheckRange(*this, offset, size));
    std::size_t done = 0;
    const int error = ReadFully(descriptor_.get(), offset, size, out, &done);
    if (error != 0) {
      return ReadFailed(error, *this, offset, size);
    }
    // Less: the file was cut since it was opened.
    return done == size
               ? absl::OkStatus()
               : FileTooShort(*this, offset, size, offset + static_cast<std::int64_t>(done));
  }

  [[nodiscard]] std::size_t ReadCached(std::int64_t offset, std::size_t size,
                                       char* out) const override {
    const iovec part = {.iov_base = out, .iov_len = std::min(size, kMaxTransferBytes)};
    const ssize_t count = preadv2(descriptor_.get(), &part, 1, offset, RWF_NOWAIT);
    return count < 0 ? 0 : static_cast<std::size_t>(count);
  }

  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }
  [[nodiscard]] const std::string& path() const override { return path_; }
  void ExpectScatteredReads() const override {
    // This is advice. It changes no byte, so an error does not matter.
    static_cast<void>(posix_fadvise(descriptor_.get(), 0, 0, POSIX_FADV_RANDOM));
  }
  [[nodiscard]] int descriptor() const override { return descriptor_.get(); }

 private:
  const Descriptor descriptor_;
  const std::int64_t size_bytes_;
  const std::string path_;
};

// A file that is mounted, for one of its readers.
class MountedReader : public RandomAccessFile {
 public:
  explicit MountedReader(std::shared_ptr<const RandomAccessFile> file) : file_(std::move(file)) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return file_->ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return file_->path(); }

 private:
  const std::shared_ptr<const RandomAccessFile> file_;
};

// Memory that direct writes accept.
class AlignedBuffer {
 public:
  explicit AlignedBuffer(std::size_t capacity)
      : bytes_(static_cast<char*>(::operator new(capacity, kAlignment))) {}
  ~AlignedBuffer() { ::operator delete(bytes_, kAlignment); }
  AlignedBuffer(const AlignedBuffer&) = delete;
  AlignedBuffer& operator=(const AlignedBuffer&) = delete;

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] absl::string_view view() const { return {bytes_, size_}; }
  // REQUIRES: the capacity suffices.
  void Append(absl::string_view bytes) {
    std::memcpy(bytes_ + size_, bytes.data(), bytes.size());
    size_ += bytes.size();
  }
  void Clear() { size_ = 0; }

 private:
  static constexpr auto kAlignment = std::align_val_t(kDirectAlignment);

  char* const bytes_;
  std::size_t size_ = 0;
};

// Buffers one stretch of bytes: those of [buffer_offset_, buffer_offset_ + buffer_.size()) that are
// not in the file yet. Writes that continue the stretch join it; any other flushes it first.
class PosixWritableFile : public WritableFile {
 public:
  // direct: opened with O_DIRECT; none: everything goes through the page cache
  PosixWritableFile(Descriptor descriptor, std::optional<Descriptor> direct, std::string path,
                    std::size_t buffer_bytes, std::int64_t size_bytes = 0)
      : descriptor_(std::move(descriptor)),
        direct_(std::move(direct)),
        path_(std::move(path)),
        buffer_bytes_(buffer_bytes),
        buffer_(buffer_bytes),
        buffer_offset_(size_bytes),
        size_bytes_(size_bytes) {
    ISOSCOPE_CHECK(std::has_single_bit(buffer_bytes));
    ISOSCOPE_CHECK(!direct_.has_value() || buffer_bytes % kDirectAlignment == 0);
  }

  [[nodiscard]] absl::Status Append(absl::string_view bytes) override {
    return WriteAt(size_bytes_, bytes);
  }

  [[nodiscard]] absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) override {
    ISOSCOPE_CHECK_GE(offset, 0);
    if (is_closed_) {
      return absl::FailedPreconditionError(absl::StrCat("write ", path_, ": already closed"));
    }
    ISOSCOPE_RETURN_IF_ERROR(status_);
    if (bytes.empty()) {
      return absl::OkStatus();
    }
    const std::int64_t end = offset + static_cast<std::int64_t>(bytes.size());
    if (offset != buffer_offset_ + static_cast<std::int64_t>(buffer_.size())) {
      ISOSCOPE_RETURN_IF_ERROR(Flush());
      buffer_offset_ = offset;
    }
    while (!bytes.empty()) {
      const std::size_t to_boundary =
          buffer_bytes_ -
          ((static_cast<std::size_t>(buffer_offset_) + buffer_.size()) & (buffer_bytes_ - 1));
      if (!direct_.has_value() && buffer_.size() == 0 && bytes.size() >= to_boundary) {
        // Everything up to the last boundary goes out at once. The bytes of direct writes have to
        // be aligned, so they go through the buffer.
        const std::size_t size =
            to_boundary + ((bytes.size() - to_boundary) & ~(buffer_bytes_ - 1));
        status_ = WriteFully(descriptor_.get(), buffer_offset_, bytes.substr(0, size), path_);
        ISOSCOPE_RETURN_IF_ERROR(status_);
        buffer_offset_ += static_cast<std::int64_t>(size);
        bytes.remove_prefix(size);
        continue;
      }
      const std::size_t size = std::min(bytes.size(), to_boundary);
      buffer_.Append(bytes.substr(0, size));
      bytes.remove_prefix(size);
      if (size == to_boundary) {
        ISOSCOPE_RETURN_IF_ERROR(Flush());
      }
    }
    size_bytes_ = std::max(size_bytes_, end);
    return absl::OkStatus();
  }

  [[nodiscard]] absl::Status Close() override {
    if (is_closed_) {
      return status_;
    }
    if (status_.ok()) {
      status_ = Flush();
    }
    if (status_.ok()) {
      status_ = Sync(descriptor_.get(), path_);
    }
    const int error_number = descriptor_.Close();
    is_closed_ = true;
    if (status_.ok() && error_number != 0) {
      status_ = ErrnoToStatus(error_number, "close", path_);
    }
    return status_;
  }

  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }

 private:
  absl::Status Flush() {
    if (IsWhole()) {
      status_ = WriteDirectly();
      ISOSCOPE_RETURN_IF_ERROR(status_);
    }
    status_ = WriteFully(descriptor_.get(), buffer_offset_, buffer_.view(), path_);
    ISOSCOPE_RETURN_IF_ERROR(status_);
    buffer_offset_ += static_cast<std::int64_t>(buffer_.size());
    buffer_.Clear();
    return absl::OkStatus();
  }

  [[nodiscard]] bool IsWhole() const {
    return direct_.has_value() && buffer_.size() == buffer_bytes_ &&
           buffer_offset_ % static_cast<std::int64_t>(buffer_bytes_) == 0;
  }

  // Writes the buffer past the page cache. What is left of it then has to go through the cache: all
  // of it where the file system refuses such writes, which it may do late.
  absl::Status WriteDirectly() {
    ssize_t count = 0;
    do {
      count = pwrite(direct_->get(), buffer_.view().data(), buffer_.size(), buffer_offset_);
    } while (count < 0 && errno == EINTR);
    if (count < 0 && errno != EINVAL) {
      return ErrnoToStatus(
          errno, absl::StrFormat("write %d bytes at offset %d of", buffer_.size(), buffer_offset_),
          path_);
    }
    if (count < 0) {
      direct_.reset();
      return absl::OkStatus();
    }
    if (static_cast<std::size_t>(count) == buffer_.size()) {
      buffer_offset_ += count;
      buffer_.Clear();
    }
    return absl::OkStatus();
  }

  Descriptor descriptor_;
  std::optional<Descriptor> direct_;
  const std::string path_;
  const std::size_t buffer_bytes_;
  AlignedBuffer buffer_;
  std::int64_t buffer_offset_;
  std::int64_t size_bytes_;
  absl::Status status_;  // the first error
  bool is_closed_ = false;
};

}  // namespace

absl::Status CheckRange(const RandomAccessFile& file, std::int64_t offset, std::size_t size) {
  ISOSCOPE_CHECK_GE(offset, 0);
  const std::int64_t end = file.size_bytes();
  if (offset > end || size > static_cast<std::size_t>(end - offset)) {
    return FileTooShort(file, offset, size, end);
  }
  return absl::OkStatus();
}

absl::Status FileTooShort(const RandomAccessFile& file, std::int64_t offset, std::size_t size,
                          std::int64_t end) {
  // Not StrFormat, which ends the process if memory runs out: it writes in a destructor.
  return absl::DataLossError(absl::StrCat(file.path(), ": ends after ", end, " bytes, expected ",
                                          size, " bytes at offset ", offset));
}

absl::Status ReadFailed(int error_number, const RandomAccessFile& file, std::int64_t offset,
                        std::size_t size) {
  return ErrnoToStatus(
      error_number, absl::StrCat("read ", size, " bytes at offset ", offset, " of"), file.path());
}

int ReadFully(int descriptor, std::int64_t offset, std::size_t size, char* out, std::size_t* done,
              std::size_t max_transfer_bytes) {
  while (*done < size) {
    const ssize_t count = pread(descriptor, out + *done, std::min(size - *done, max_transfer_bytes),
                                offset + static_cast<std::int64_t>(*done));
    if (count < 0 && errno != EINTR) {
      return errno;
    }
    if (count == 0) {
      return 0;
    }
    *done += count < 0 ? 0 : static_cast<std::size_t>(count);
  }
  return 0;
}

absl::Status WriteFully(int descriptor, std::int64_t offset, absl::string_view bytes,
                        const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t count =
        pwrite(descriptor, bytes.data(), std::min(bytes.size(), kMaxTransferBytes), offset);
    if (count < 0 && errno != EINTR) {
      return ErrnoToStatus(
          errno, absl::StrFormat("write %d bytes at offset %d of", bytes.size(), offset), path);
    }
    bytes.remove_prefix(count < 0 ? 0 : static_cast<std::size_t>(count));
    offset += std::max<ssize_t>(count, 0);
  }
  return absl::OkStatus();
}

absl::Status CheckIsRegularFile(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 ? CheckMode(info.st_mode, path) : absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RandomAccessFile>> OpenRandomAccessFile(const std::string& path) {
  if (std::optional<MountedFile> mounted = FindMounted(path); mounted.has_value()) {
    return std::make_unique<MountedReader>(std::move(mounted->file));
  }
  // O_NONBLOCK: opening a FIFO would wait for its writer. Regular files ignore it.
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptor descriptor,
                            OpenDescriptor(path, O_RDONLY | O_NONBLOCK, 0, "open"));
  struct stat info {};
  if (fstat(descriptor.get(), &info) != 0) {
    return ErrnoToStatus(errno, "stat", path);
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckMode(info.st_mode, path));
  if (fcntl(descriptor.get(), F_SETFL, 0) != 0) {  // some kernels' io_uring heeds O_NONBLOCK
    return ErrnoToStatus(errno, "set up", path);
  }
  return std::make_unique<PosixRandomAccessFile>(std::move(descriptor), info.st_size, path);
}

absl::StatusOr<std::unique_ptr<WritableFile>> CreateBufferedFile(const std::string& path,
                                                                 std::size_t buffer_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptor descriptor,
                            OpenDescriptor(path, O_WRONLY | O_CREAT | O_EXCL, 0666, "create"));
  return std::make_unique<PosixWritableFile>(std::move(descriptor), std::nullopt, path,
                                             buffer_bytes);
}

absl::StatusOr<std::unique_ptr<WritableFile>> ContinueWritableFile(const std::string& path,
                                                                   std::int64_t size_bytes) {
  ISOSCOPE_CHECK_GE(size_bytes, 0);
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptor descriptor,
                            OpenDescriptor(path, O_WRONLY | O_NONBLOCK, 0, "open"));
  struct stat info {};
  if (fstat(descriptor.get(), &info) != 0) {
    return ErrnoToStatus(errno, "stat", path);
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckMode(info.st_mode, path));
  if (info.st_size < size_bytes) {
    return absl::DataLossError(absl::StrCat(path, ": ends after ", info.st_size,
                                            " bytes, expected at least ", size_bytes));
  }
  if (ftruncate(descriptor.get(), size_bytes) != 0) {
    return ErrnoToStatus(errno, "cut", path);
  }
  return std::make_unique<PosixWritableFile>(std::move(descriptor), std::nullopt, path,
                                             kWriteBufferBytes, size_bytes);
}

absl::StatusOr<std::unique_ptr<WritableFile>> CreateDirectFile(const std::string& path,
                                                               std::size_t buffer_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptor descriptor,
                            OpenDescriptor(path, O_WRONLY | O_CREAT | O_EXCL, 0666, "create"));
  absl::StatusOr<Descriptor> direct = OpenDescriptor(path, O_WRONLY | O_DIRECT, 0, "open");
  std::optional<Descriptor> used;
  if (direct.ok()) {  // else the file system has no such writes
    used.emplace(*std::move(direct));
  }
  return std::make_unique<PosixWritableFile>(std::move(descriptor), std::move(used), path,
                                             buffer_bytes);
}

absl::StatusOr<std::unique_ptr<WritableFile>> CreateWritableFile(const std::string& path) {
  return CreateBufferedFile(path, kWriteBufferBytes);
}

absl::StatusOr<std::string> ReadWholeFile(const std::string& path, std::int64_t max_size_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, OpenRandomAccessFile(path));
  return ReadWholeFile(*file, max_size_bytes);
}

absl::StatusOr<std::string> ReadWholeFile(const RandomAccessFile& file,
                                          std::int64_t max_size_bytes) {
  if (file.size_bytes() > max_size_bytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d bytes, expected at most %d", file.path(), file.size_bytes(), max_size_bytes));
  }
  std::string bytes(static_cast<std::size_t>(file.size_bytes()), '\0');
  ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(0, bytes.size(), bytes.data()));
  return bytes;
}

absl::Status WriteWholeFile(const std::string& path, absl::string_view bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, CreateWritableFile(path));
  absl::Status status = file->Append(bytes);
  if (status.ok()) {
    status = file->Close();
  }
  if (!status.ok()) {
    unlink(path.c_str());
  }
  return status;
}

absl::Status CreateDirectory(const std::string& path) {
  if (mkdir(path.c_str(), 0777) != 0) {
    return ErrnoToStatus(errno, "create directory", path);
  }
  return absl::OkStatus();
}

absl::Status RenamePath(const std::string& from, const std::string& to) {
  struct stat from_info {};
  if (lstat(from.c_str(), &from_info) != 0) {
    return ErrnoToStatus(errno, "rename", from);
  }
  struct stat to_info {};
  const bool to_exists = lstat(to.c_str(), &to_info) == 0;
  if (to_exists && (S_ISDIR(from_info.st_mode) || S_ISDIR(to_info.st_mode))) {
    return absl::AlreadyExistsError(
        absl::StrCat("rename ", from, " to ", to, ": the target exists"));
  }
  int result = 0;
  if (S_ISDIR(from_info.st_mode)) {
    // rename(2) would replace an empty directory that someone made since the check above.
    result = renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE);
    if (result != 0 && (errno == EINVAL || errno == ENOSYS)) {  // not on every file system
      result = rename(from.c_str(), to.c_str());
    }
  } else {
    result = rename(from.c_str(), to.c_str());
  }
  if (result != 0) {
    return ErrnoToStatus(errno, absl::StrCat("rename ", from, " to"), to);
  }
  const std::string from_parent = ParentOf(from);
  const std::string to_parent = ParentOf(to);
  ISOSCOPE_RETURN_IF_ERROR(SyncDirectory(to_parent));
  return from_parent == to_parent ? absl::OkStatus() : SyncDirectory(from_parent);
}

absl::Status SyncDirectory(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Descriptor descriptor,
                            OpenDescriptor(path, O_RDONLY | O_DIRECTORY, 0, "open directory"));
  return Sync(descriptor.get(), path);
}

absl::Status RemoveRecursively(const std::string& path) {
  const base::OrderlyEnd removal(kMaxRemovalDuration);
  std::error_code error;
  std::filesystem::remove_all(path, error);
  return error ? ErrnoToStatus(error.value(), "remove", path) : absl::OkStatus();
}

std::int64_t BytesBelow(const std::string& path) {
  std::int64_t bytes = 0;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator entry(path, error), end;
       !error && entry != end; entry.increment(error)) {
    std::error_code vanished;
    if (entry->is_regular_file(vanished)) {
      const std::uintmax_t size = entry->file_size(vanished);
      bytes += vanished ? 0 : static_cast<std::int64_t>(size);
    }
  }
  return bytes;
}

bool PathExists(const std::string& path) {
  struct stat info {};
  return IsMounted(path) || stat(path.c_str(), &info) == 0;
}

bool IsDirectory(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

absl::Status ErrnoToStatus(int error_number, absl::string_view what, absl::string_view path) {
  // std::generic_category, because strerror is not thread-safe.
  const std::string message =
      absl::StrCat(what, " ", path, ": ", std::generic_category().message(error_number));
  switch (error_number) {
    case ENOENT:
    case ENOTDIR:
      return absl::NotFoundError(message);
    case EACCES:
    case EPERM:
    case EROFS:
      return absl::PermissionDeniedError(message);
    case EEXIST:
    case ENOTEMPTY:
      return absl::AlreadyExistsError(message);
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
    case EMFILE:
    case ENFILE:
    case ENOMEM:
      return absl::ResourceExhaustedError(message);
    case EIO:
      return absl::DataLossError(message);
    default:
      return absl::InternalError(message);
  }
}

}  // namespace isoscope::io
