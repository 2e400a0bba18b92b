// Arrays that live in a file without a name, mapped into memory: the system writes back and drops
// their pages when memory is short, so that they may be larger than memory.

#ifndef ISOSCOPE_CORE_IO_FILE_ARRAY_H_
#define ISOSCOPE_CORE_IO_FILE_ARRAY_H_

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/status_macros.h"

namespace isoscope::io {

// The bytes of a FileArray. Thread-compatible.
class MappedScratch {
 public:
  // The file lies on the file system of `directory`. Errors as CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<MappedScratch>> Create(const std::string& directory);
  ~MappedScratch();
  MappedScratch(const MappedScratch&) = delete;
  MappedScratch& operator=(const MappedScratch&) = delete;

  // Makes room for `size` bytes; new ones are 0. Reserves the disk first: a full one is
  // RESOURCE_EXHAUSTED here, never a signal later. Moves the bytes.
  absl::Status Reserve(std::size_t size);
  [[nodiscard]] char* data() const { return data_; }

 private:
  MappedScratch(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}

  const int fd_;
  const std::string path_;  // its name when it was made, for messages
  char* data_ = nullptr;
  std::size_t capacity_ = 0;
};

// A growing array of plain values. Thread-compatible.
template <typename T>
class FileArray {
 public:
  static_assert(std::is_trivially_copyable_v<T>);

  static absl::StatusOr<FileArray> Create(const std::string& directory) {
    FileArray array;
    ISOSCOPE_ASSIGN_OR_RETURN(array.bytes_, MappedScratch::Create(directory));
    return array;
  }

  // New elements are 0; earlier spans become invalid. An array that has shrunk keeps the old values
  // behind its end, so it must not grow again.
  absl::Status Resize(std::size_t size) {
    ISOSCOPE_RETURN_IF_ERROR(bytes_->Reserve(size * sizeof(T)));
    size_ = size;
    return absl::OkStatus();
  }
  absl::Status Append(std::span<const T> values) {
    const std::size_t begin = size_;
    ISOSCOPE_RETURN_IF_ERROR(Resize(begin + values.size()));
    std::copy(values.begin(), values.end(), data() + begin);
    return absl::OkStatus();
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] T* data() { return reinterpret_cast<T*>(bytes_->data()); }
  [[nodiscard]] std::span<T> values() { return {data(), size_}; }
  [[nodiscard]] std::span<const T> values() const {
    return {reinterpret_cast<const T*>(bytes_->data()), size_};
  }

 private:
  FileArray() = default;

  std::unique_ptr<MappedScratch> bytes_;
  std::size_t size_ = 0;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_FILE_ARRAY_H_
