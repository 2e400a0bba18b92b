// A file without a name, for data that do not fit into memory. It is gone when it is closed, even
// if the process crashes.

#ifndef ISOSCOPE_CORE_IO_SCRATCH_FILE_H_
#define ISOSCOPE_CORE_IO_SCRATCH_FILE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace isoscope::io {

struct UnnamedFile {
  int descriptor = -1;
  std::string path = {};  // the name when it was made, for messages
};

// Creates a file without a name on the file system of `directory`, which exists. The caller closes
// the descriptor. Errors as in file.h.
absl::StatusOr<UnnamedFile> CreateUnnamedFile(const std::string& directory);

// Stretches that do not overlap may be written and read at the same time. Errors as in file.h.
class ScratchFile {
 public:
  // Creates the file on the file system of `directory`, which exists.
  static absl::StatusOr<std::unique_ptr<ScratchFile>> Create(const std::string& directory);
  ~ScratchFile();
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  absl::Status WriteAt(std::int64_t offset, const char* bytes, std::size_t size);
  // DATA_LOSS if the file ends before.
  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) const;

 private:
  ScratchFile(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}

  const int fd_;
  const std::string path_;  // its name when it was made, for messages
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_SCRATCH_FILE_H_
