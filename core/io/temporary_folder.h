// A folder for files that a command needs only while it runs.

#ifndef ISOSCOPE_CORE_IO_TEMPORARY_FOLDER_H_
#define ISOSCOPE_CORE_IO_TEMPORARY_FOLDER_H_

#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/process_interrupt.h"
#include "core/io/file.h"

namespace isoscope::io {

// The destructor removes the folder with its contents. That includes interrupts, which end a
// command as any error does, and the end of a process that stands still. Thread-compatible.
class TemporaryFolder {
 public:
  // Makes a folder in $TMPDIR or /tmp that only this user can read. The error names that folder.
  static absl::StatusOr<TemporaryFolder> Make();
  ~TemporaryFolder();
  TemporaryFolder(TemporaryFolder&& other) noexcept
      : path_(std::exchange(other.path_, "")), unfinished_(std::move(other.unfinished_)) {}
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  // `path()/name`.
  [[nodiscard]] std::string Sub(absl::string_view name) const {
    return absl::StrCat(path_, "/", name);
  }
  // Creates `path()/name`, which must not exist. Nothing is buffered, and Close() does not wait for
  // the disk: the file is of no use after a crash. Errors as CreateWritableFile.
  [[nodiscard]] absl::StatusOr<std::unique_ptr<WritableFile>> CreateFile(
      absl::string_view name) const;

 private:
  explicit TemporaryFolder(std::string path)
      : path_(std::move(path)), unfinished_(std::make_unique<base::UnfinishedPath>(path_)) {}

  std::string path_;  // empty: moved from
  std::unique_ptr<base::UnfinishedPath> unfinished_;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_TEMPORARY_FOLDER_H_
