// The words, numbers and arrays of a legacy VTK file, one after the other (legacy_vtk_parser.h).

#ifndef ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_WORDS_H_
#define ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_WORDS_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"
#include "core/math/vec.h"
#include "core/source/bytes/text_scanner.h"

namespace isoscope::source {

// Thread-compatible. Errors are INVALID_ARGUMENT: the file ends, or holds something else than is
// asked for. Their messages are to follow the file's name and a colon.
class LegacyWords {
 public:
  // `file` must outlive it.
  explicit LegacyWords(const io::RandomAccessFile* file) : file_(file), scanner_(file) {}

  [[nodiscard]] const io::RandomAccessFile& file() const { return *file_; }
  [[nodiscard]] std::int64_t position() const { return scanner_.position(); }
  [[nodiscard]] bool is_at_end() const { return scanner_.is_at_end(); }

  // As TextScanner.
  absl::StatusOr<absl::string_view> NextLine() { return scanner_.NextLine(); }
  // Returns the keyword in upper case; "" at the end of the file.
  absl::StatusOr<std::string> NextKeyword();
  // A word of 1 to 1024 bytes.
  absl::StatusOr<std::string> NextText();
  // A number from `least` to `most`. `what` is for messages.
  absl::StatusOr<std::int64_t> NextCount(const std::string& what, std::int64_t least,
                                         std::int64_t most);
  // Three finite numbers.
  absl::StatusOr<math::Vec3d> NextVector(const std::string& what);

  // Moves behind an array of numbers, `bits` each in binary files. REQUIRES: the product of all
  // three is below 2^63.
  absl::Status PassNumbers(std::int64_t components, std::int64_t tuples, std::int64_t bits,
                           bool is_binary);
  // Moves behind an array of texts.
  absl::Status PassTexts(std::int64_t count, bool is_binary);

 private:
  const io::RandomAccessFile* file_;
  TextScanner scanner_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_WORDS_H_
