// Files that appear whole or not at all.

#ifndef ISOSCOPE_CORE_IO_ATOMIC_FILE_H_
#define ISOSCOPE_CORE_IO_ATOMIC_FILE_H_

#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/process_interrupt.h"
#include "core/io/file.h"

namespace isoscope::io {

// Returns true for a device, a pipe or a socket.
bool IsSpecialFile(const std::string& path);

// Checks that a file can be made at `path`, or that the one there can be replaced. Leaves no trace.
// Errors name the path and the reason.
absl::Status CheckWritable(const std::string& path);

// Writes `bytes` to `path` under another name first and renames it: `path` is the old file or the
// whole new one. A device or a pipe is written directly.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes);

// A file that is written piece by piece. It appears whole, in one step, or not at all. A device or
// a pipe is written directly. Thread-compatible.
class AtomicFile {
 public:
  // Errors as CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<AtomicFile>> Create(const std::string& path);
  // Removes the written bytes unless Commit was called.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  absl::Status Append(absl::string_view bytes);
  // Writes over earlier bytes, or behind them. Fails for a pipe.
  absl::Status WriteAt(std::int64_t offset, absl::string_view bytes);
  // Gives the file its name. Call it once, last.
  absl::Status Commit();

  [[nodiscard]] std::int64_t size_bytes() const { return size_bytes_; }

 private:
  explicit AtomicFile(const std::string& path);
  [[nodiscard]] absl::Status SpecialStatus() const;

  const std::string path_;
  const std::string partial_path_;  // empty for devices and pipes
  std::optional<base::UnfinishedPath> unfinished_;
  std::unique_ptr<WritableFile> file_;      // null for devices and pipes
  std::unique_ptr<std::ofstream> special_;  // for devices and pipes
  std::int64_t size_bytes_ = 0;
  bool is_committed_ = false;
};

// Returns the name under which `path` is written before it is whole. No other process uses it.
std::string PartialName(const std::string& path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_ATOMIC_FILE_H_
