#include "core/io/scratch_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/transfers.h"

namespace isoscope::io {

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
  return WriteFully(fd_, offset, {bytes, size}, path_);
}

absl::Status ScratchFile::ReadAt(std::int64_t offset, std::size_t size, char* out) const {
  std::size_t done = 0;
  const int error = ReadFully(fd_, offset, size, out, &done);
  offset += static_cast<std::int64_t>(done);
  size -= done;
  if (error != 0) {
    return ErrnoToStatus(error, absl::StrFormat("read %d bytes at offset %d of", size, offset),
                         path_);
  }
  return size == 0 ? absl::OkStatus()
                   : absl::DataLossError(absl::StrFormat("%s: ends at %d, expected %d bytes more",
                                                         path_, offset, size));
}

}  // namespace isoscope::io
