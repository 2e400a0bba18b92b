// A file that is not in memory, for the tests of ReadQueue.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_IO_COLD_FILE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_IO_COLD_FILE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/io/file.h"

namespace isoscope::io {

// Forwards all calls, but finds nothing in memory: each read goes through the engine.
class ColdFile : public RandomAccessFile {
 public:
  // cut_bytes: the bytes by which the file reports too large a size, as if it had been cut
  explicit ColdFile(std::unique_ptr<RandomAccessFile> file, bool has_descriptor = true,
                    std::int64_t cut_bytes = 0)
      : file_(std::move(file)), has_descriptor_(has_descriptor), cut_bytes_(cut_bytes) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return file_->ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return file_->size_bytes() + cut_bytes_;
  }
  [[nodiscard]] const std::string& path() const override { return file_->path(); }
  [[nodiscard]] int descriptor() const override {
    return has_descriptor_ ? file_->descriptor() : -1;
  }

 private:
  const std::unique_ptr<RandomAccessFile> file_;
  const bool has_descriptor_;
  const std::int64_t cut_bytes_;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_TESTS_UNIT_CORE_IO_COLD_FILE_H_
