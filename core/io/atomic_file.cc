#include "core/io/atomic_file.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"

namespace isoscope::io {

bool IsSpecialFile(const std::string& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  return std::filesystem::exists(status) && std::filesystem::is_other(status);
}

AtomicFile::AtomicFile(const std::string& path)
    : path_(path), partial_path_(IsSpecialFile(path) ? "" : PartialName(path)) {}

absl::StatusOr<std::unique_ptr<AtomicFile>> AtomicFile::Create(const std::string& path) {
  std::unique_ptr<AtomicFile> made(new AtomicFile(path));
  if (made->partial_path_.empty()) {
    made->special_ = std::make_unique<std::ofstream>(path, std::ios::binary);
    return made;
  }
  ISOSCOPE_RETURN_IF_ERROR(RemoveRecursively(made->partial_path_));
  made->unfinished_.emplace(made->partial_path_);
  ISOSCOPE_ASSIGN_OR_RETURN(made->file_, CreateWritableFile(made->partial_path_));
  return made;
}

AtomicFile::~AtomicFile() {
  if (!is_committed_ && !partial_path_.empty()) {
    file_.reset();
    RemoveRecursively(partial_path_).IgnoreError();
  }
}

absl::Status AtomicFile::SpecialStatus() const {
  return special_->good() ? absl::OkStatus()
                          : absl::DataLossError(absl::StrCat("can't write to '", path_, "'"));
}

absl::Status AtomicFile::Append(absl::string_view bytes) {
  size_bytes_ += static_cast<std::int64_t>(bytes.size());
  if (file_ != nullptr) {
    return file_->Append(bytes);
  }
  special_->write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return SpecialStatus();
}

absl::Status AtomicFile::WriteAt(std::int64_t offset, absl::string_view bytes) {
  size_bytes_ = std::max(size_bytes_, offset + static_cast<std::int64_t>(bytes.size()));
  if (file_ != nullptr) {
    return file_->WriteAt(offset, bytes);
  }
  special_->seekp(offset);
  special_->write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  special_->seekp(0, std::ios::end);
  return SpecialStatus();
}

absl::Status AtomicFile::Commit() {
  if (file_ == nullptr) {
    special_->close();
    return SpecialStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(file_->Close());
  ISOSCOPE_RETURN_IF_ERROR(RenamePath(partial_path_, path_));
  is_committed_ = true;
  return absl::OkStatus();
}

std::string PartialName(const std::string& path) {
  return absl::StrCat(path, ".partial-", getpid());
}

absl::Status CheckWritable(const std::string& path) {
  if (IsSpecialFile(path)) {
    return absl::OkStatus();
  }
  if (IsDirectory(path)) {
    return absl::FailedPreconditionError(
        absl::StrCat("'", path, "' is a folder; the name of a file is expected"));
  }
  const std::string partial = PartialName(path);
  ISOSCOPE_RETURN_IF_ERROR(RemoveRecursively(partial));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<WritableFile> file, CreateWritableFile(partial));
  return RemoveRecursively(partial);
}

absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  ISOSCOPE_RETURN_IF_ERROR(file->Append(bytes));
  return file->Commit();
}

}  // namespace isoscope::io
