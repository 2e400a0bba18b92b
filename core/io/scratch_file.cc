#include "core/io/scratch_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::io {
namespace {

// Linux moves at most 2^31 - 4096 bytes in one call.
constexpr auto kMaxScratchTransferBytes = static_cast<std::size_t>(base::kGiB);

}  // namespace

absl::StatusOr<UnnamedFile> CreateUnnamedFile(const std::string& directory) {
  UnnamedFile file{.path = absl::StrCat(directory, "/scratch-XXXXXX")};
  file.descriptor = mkostemp(file.path.data(), O_CLOEXEC);
  if (file.descriptor < 0) {
    return ErrnoToStatus(errno, "create", file.path);
  }
  if (unlink(file.path.c_str()) != 0) {
    const absl::Status status = ErrnoToStatus(errno, "unlink", file.path);
    close(file.descriptor);
    return status;
  }
  return file;
}

absl::StatusOr<std::unique_ptr<ScratchFile>> ScratchFile::Create(const std::string& directory) {
  ISOSCOPE_ASSIGN_OR_RETURN(UnnamedFile file, CreateUnnamedFile(directory));
  return std::unique_ptr<ScratchFile>(new ScratchFile(file.descriptor, std::move(file.path)));
}

ScratchFile::~ScratchFile() { close(fd_); }

absl::Status ScratchFile::WriteAt(std::int64_t offset, const char* bytes, std::size_t size) {
  while (size > 0) {
    const ssize_t count = pwrite(fd_, bytes, std::min(size, kMaxScratchTransferBytes), offset);
    if (count < 0 && errno == EINTR) {
      continue;
    }
    if (count < 0) {
      return ErrnoToStatus(errno, absl::StrFormat("write %d bytes at offset %d of", size, offset),
                           path_);
    }
    bytes += count;
    size -= static_cast<std::size_t>(count);
    offset += count;
  }
  return absl::OkStatus();
}

absl::Status ScratchFile::ReadAt(std::int64_t offset, std::size_t size, char* out) const {
  while (size > 0) {
    const ssize_t count = pread(fd_, out, std::min(size, kMaxScratchTransferBytes), offset);
    if (count < 0 && errno == EINTR) {
      continue;
    }
    if (count < 0) {
      return ErrnoToStatus(errno, absl::StrFormat("read %d bytes at offset %d of", size, offset),
                           path_);
    }
    if (count == 0) {
      return absl::DataLossError(
          absl::StrFormat("%s: ends at %d, expected %d bytes more", path_, offset, size));
    }
    out += count;
    size -= static_cast<std::size_t>(count);
    offset += count;
  }
  return absl::OkStatus();
}

}  // namespace isoscope::io
