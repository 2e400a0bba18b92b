// Files that live in a string: no disk, exactly sized buffers (a read past the end is seen by the
// address sanitizer), and writes that fail on demand.

#ifndef ISOSCOPE_TESTS_SUPPORT_MEMORY_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_MEMORY_FILE_H_

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"

namespace isoscope::testing {

// Thread-safe.
class MemoryReadFile : public io::RandomAccessFile {
 public:
  explicit MemoryReadFile(absl::string_view bytes) : bytes_(bytes.begin(), bytes.end()) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    if (offset < 0 || offset > size_bytes() ||
        size > static_cast<std::size_t>(size_bytes() - offset)) {
      return absl::DataLossError(
          absl::StrCat(path_, ": no ", size, " bytes at offset ", offset, " of ", size_bytes()));
    }
    if (size > 0) {
      std::memcpy(out, bytes_.data() + offset, size);
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return static_cast<std::int64_t>(bytes_.size());
  }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::vector<char> bytes_;
  const std::string path_ = "memory_file";
};

// Writes to `*bytes`, which must outlive it. Thread-compatible.
class MemoryWriteFile : public io::WritableFile {
 public:
  // The operation (Append, WriteAt or Close) number `failing_operation`, from 0, and all after it
  // are RESOURCE_EXHAUSTED; < 0: none.
  explicit MemoryWriteFile(std::string* bytes, std::int64_t failing_operation = -1)
      : bytes_(bytes), failing_operation_(failing_operation) {}

  [[nodiscard]] absl::Status Append(absl::string_view bytes) override {
    absl::Status status = CountOperation();
    if (status.ok()) {
      bytes_->append(bytes.data(), bytes.size());
    }
    return status;
  }
  [[nodiscard]] absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) override {
    absl::Status status = CountOperation();
    if (status.ok()) {
      bytes_->replace(static_cast<std::size_t>(offset), bytes.size(), bytes.data(), bytes.size());
    }
    return status;
  }
  [[nodiscard]] absl::Status Close() override {
    absl::Status status = CountOperation();
    is_closed_ = status.ok();
    return status;
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return static_cast<std::int64_t>(bytes_->size());
  }

  [[nodiscard]] std::int64_t operation_count() const { return operation_count_; }
  [[nodiscard]] bool is_closed() const { return is_closed_; }

 private:
  absl::Status CountOperation() {
    const std::int64_t operation = operation_count_++;
    return failing_operation_ >= 0 && operation >= failing_operation_
               ? absl::ResourceExhaustedError("memory_file: disk full (injected)")
               : absl::OkStatus();
  }

  std::string* bytes_;
  std::int64_t failing_operation_;
  std::int64_t operation_count_ = 0;
  bool is_closed_ = false;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MEMORY_FILE_H_
