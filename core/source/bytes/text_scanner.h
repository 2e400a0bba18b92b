// Words and lines of a file, front to back, in bounded memory.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SCANNER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SCANNER_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"

namespace isoscope::source {

// Thread-compatible. Holds 64 KiB. Errors are those of ReadAt, and INVALID_ARGUMENT for a word or a
// line of more than 64 KiB.
class TextScanner {
 public:
  // Starts at `offset`. `file` must outlive the scanner.
  explicit TextScanner(const io::RandomAccessFile* file, std::int64_t offset = 0)
      : file_(file), buffer_offset_(offset) {}

  // The next word, behind any white space; "" at the end of the file. Valid until the next call.
  absl::StatusOr<absl::string_view> NextWord();
  // The rest of the line, without its end ("\n" or "\r\n"), which is passed. "" at the end of the
  // file. Valid until the next call.
  absl::StatusOr<absl::string_view> NextLine();

  // The offset in the file of the next byte.
  [[nodiscard]] std::int64_t position() const {
    return buffer_offset_ + static_cast<std::int64_t>(next_);
  }
  [[nodiscard]] bool is_at_end() const { return position() >= file_->size_bytes(); }
  // Goes on at another offset.
  void MoveTo(std::int64_t offset);

 private:
  // Moves the unread bytes to the front and reads more behind them. False at the end of the file.
  absl::StatusOr<bool> Fill();

  const io::RandomAccessFile* file_;
  std::int64_t buffer_offset_;  // of buffer_[0] in the file
  std::string buffer_;
  std::size_t next_ = 0;  // in the buffer
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SCANNER_H_
