#include "core/io/temporary_folder.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>

#include "absl/status/status.h"
#include <sys/stat.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/transfers.h"

namespace isoscope::io {
namespace {

class TemporaryFile final : public WritableFile {
 public:
  TemporaryFile(int descriptor, std::string path)
      : descriptor_(descriptor), path_(std::move(path)) {}
  ~TemporaryFile() override { TemporaryFile::Close().IgnoreError(); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  [[nodiscard]] absl::Status Append(absl::string_view bytes) override {
    return WriteAt(size_bytes_, bytes);
  }
  [[nodiscard]] absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) override {
    ISOSCOPE_CHECK_GE(offset, 0);
    if (descriptor_ < 0) {
      return absl::FailedPreconditionError(absl::StrCat("write ", path_, ": already closed"));
    }
    ISOSCOPE_RETURN_IF_ERROR(status_);
    status_ = WriteFully(descriptor_, offset, bytes, path_);
    size_bytes_ = std::max(size_bytes_, offset + static_cast<std::int64_t>(bytes.size()));
    return status_;
  }
  [[nodiscard]] absl::Status Close() override {
    if (descriptor_ >= 0 && close(std::exchange(descriptor_, -1)) != 0 && status_.ok()) {
      status_ = ErrnoToStatus(errno, "close", path_);
    }
    return status_;
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }

 private:
  int descriptor_;  // -1: closed
  const std::string path_;
  std::int64_t size_bytes_ = 0;
  absl::Status status_;  // the first error
};

}  // namespace

absl::StatusOr<TemporaryFolder> TemporaryFolder::Make() {
  const char* variable = std::getenv("TMPDIR");  // NOLINT(concurrency-mt-unsafe): never set here
  const std::string parent = variable != nullptr && *variable == '/' ? variable : "/tmp";
  std::string path = absl::StrCat(parent, "/isoscope-XXXXXX");
  if (mkdtemp(path.data()) == nullptr) {
    return ErrnoToStatus(errno, "can't make a temporary folder in (set TMPDIR to another)", parent);
  }
  return TemporaryFolder(std::move(path));
}

absl::StatusOr<std::unique_ptr<WritableFile>> TemporaryFolder::CreateFile(
    absl::string_view name) const {
  std::string path = Sub(name);
  const int descriptor =
      open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (descriptor < 0) {
    return ErrnoToStatus(errno, "create", path);
  }
  return std::make_unique<TemporaryFile>(descriptor, std::move(path));
}

TemporaryFolder::~TemporaryFolder() {
  if (!path_.empty()) {
    RemoveRecursively(path_).IgnoreError();  // no caller is left to report to
  }
}

}  // namespace isoscope::io
