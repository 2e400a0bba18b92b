// Sequences of records in a scratch file: the parts of algorithms whose data do not fit into
// memory.

#ifndef ISOSCOPE_CORE_IO_SCRATCH_RECORDS_H_
#define ISOSCOPE_CORE_IO_SCRATCH_RECORDS_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/status_macros.h"
#include "core/io/scratch_file.h"

namespace isoscope::io {

// `count` records of one type that lie one after the other from `offset` on.
struct ScratchRange {
  std::int64_t offset = 0;  // bytes
  std::int64_t count = 0;   // records
};

// Returns the number of records that fit into `bytes`; at least one.
template <typename Record>
std::size_t RecordsIn(std::int64_t bytes) {
  return static_cast<std::size_t>(
      std::max<std::int64_t>(bytes / static_cast<std::int64_t>(sizeof(Record)), 1));
}

// Reads a range from its begin to its end through a buffer of its own. Thread-compatible.
template <typename Record>
requires std::is_trivially_copyable_v<Record>
class RecordReader {
 public:
  // `file` outlives the reader.
  RecordReader(const ScratchFile* file, const ScratchRange& range, std::int64_t buffer_bytes)
      : file_(file), rest_(range), buffer_records_(RecordsIn<Record>(buffer_bytes)) {}

  // Returns the next records, which are valid until the next call. None at the end.
  absl::StatusOr<absl::Span<const Record>> Next() {
    const std::size_t count = std::min(buffer_records_, static_cast<std::size_t>(rest_.count));
    const std::size_t bytes = count * sizeof(Record);
    buffer_.resize(count);
    if (count > 0) {
      ISOSCOPE_RETURN_IF_ERROR(
          file_->ReadAt(rest_.offset, bytes, reinterpret_cast<char*>(buffer_.data())));
    }
    rest_.offset += static_cast<std::int64_t>(bytes);
    rest_.count -= static_cast<std::int64_t>(count);
    return absl::MakeConstSpan(buffer_);
  }

 private:
  const ScratchFile* file_;
  ScratchRange rest_;
  std::size_t buffer_records_;
  std::vector<Record> buffer_;
};

// Writes records one after the other from an offset on, through a buffer of its own.
// Thread-compatible.
template <typename Record>
requires std::is_trivially_copyable_v<Record>
class RecordWriter {
 public:
  // `file` outlives the writer.
  RecordWriter(ScratchFile* file, std::int64_t offset, std::int64_t buffer_bytes)
      : file_(file), offset_(offset), buffer_records_(RecordsIn<Record>(buffer_bytes)) {}

  absl::Status Append(const Record& record) {
    if (buffer_.capacity() == 0) {
      buffer_.reserve(buffer_records_);
    }
    buffer_.push_back(record);
    return buffer_.size() < buffer_records_ ? absl::OkStatus() : Flush();
  }

  // Writes the records that are still in the buffer.
  absl::Status Flush() {
    const std::size_t bytes = buffer_.size() * sizeof(Record);
    ISOSCOPE_RETURN_IF_ERROR(
        file_->WriteAt(offset_, reinterpret_cast<const char*>(buffer_.data()), bytes));
    offset_ += static_cast<std::int64_t>(bytes);
    buffer_.clear();
    return absl::OkStatus();
  }

  // Returns the offset of the next record.
  [[nodiscard]] std::int64_t offset() const {
    return offset_ + static_cast<std::int64_t>(buffer_.size() * sizeof(Record));
  }

 private:
  ScratchFile* file_;
  std::int64_t offset_;
  std::size_t buffer_records_;
  std::vector<Record> buffer_;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_SCRATCH_RECORDS_H_
