#include "core/formats/vtk/legacy_vtk_words.h"

#include <array>
#include <cmath>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"

namespace isoscope::source {

absl::StatusOr<std::string> LegacyWords::NextKeyword() {
  ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner_.NextWord());
  return absl::AsciiStrToUpper(word.substr(0, 64));
}

absl::StatusOr<std::string> LegacyWords::NextText() {
  ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner_.NextWord());
  constexpr std::size_t kMaxWord = 1024;
  if (word.empty() || word.size() > kMaxWord) {
    return absl::InvalidArgumentError(
        word.empty() ? "the file ends within its header: it is cut"
                     : absl::StrCat("a word of ", word.size(), " bytes before offset ",
                                    scanner_.position(), "; expected at most ", kMaxWord));
  }
  return std::string(word);
}

absl::StatusOr<std::int64_t> LegacyWords::NextCount(const std::string& what, std::int64_t least,
                                                    std::int64_t most) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string word, NextText());
  std::int64_t count = 0;
  if (!absl::SimpleAtoi(word, &count) || count < least || count > most) {
    return absl::InvalidArgumentError(absl::StrFormat("%s \"%s\"; expected a number from %d to %d",
                                                      what, word.substr(0, 64), least, most));
  }
  return count;
}

absl::StatusOr<math::Vec3d> LegacyWords::NextVector(const std::string& what) {
  math::Vec3d vector;
  for (int axis = 0; axis < 3; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string word, NextText());
    if (!absl::SimpleAtod(word, &vector[axis])) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s has \"%s\"; expected three numbers", what, word.substr(0, 64)));
    }
  }
  return vector;
}

absl::Status LegacyWords::PassNumbers(std::int64_t components, std::int64_t tuples,
                                      std::int64_t bits, bool is_binary) {
  const std::int64_t begin = scanner_.position();
  const std::int64_t left = file_->size_bytes() - begin;
  const std::int64_t numbers = components * tuples;
  const std::int64_t bytes = is_binary ? (numbers * bits + 7) / 8 : 2 * numbers - 1;
  if (bytes > left) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "an array of %d numbers from offset %d on does not fit into the file of %d bytes: it is "
        "cut; copy it again",
        numbers, begin, file_->size_bytes()));
  }
  if (is_binary) {
    scanner_.MoveTo(begin + bytes);
    return absl::OkStatus();
  }
  for (std::int64_t i = 0; i < numbers; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner_.NextWord());
    if (word.empty()) {
      return absl::InvalidArgumentError("the file ends within an array: it is cut; copy it again");
    }
  }
  return absl::OkStatus();
}

// Binary texts have a length in front, of 1, 2, 4 or 8 bytes by the two highest bits of the first.
absl::Status LegacyWords::PassTexts(std::int64_t count, bool is_binary) {
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t begin = scanner_.position();
    if (scanner_.is_at_end()) {
      return absl::InvalidArgumentError("the file ends within an array of texts: it is cut");
    }
    if (!is_binary) {
      ISOSCOPE_RETURN_IF_ERROR(scanner_.NextLine().status());
      continue;
    }
    std::array<char, 8> head{};
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(begin, 1, head.data()));
    const auto first = static_cast<unsigned char>(head[0]);
    const int bytes = 1 << (3 - (first >> 6));
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(begin, static_cast<std::size_t>(bytes), head.data()));
    std::uint64_t length = first & 0x3fU;
    for (int byte = 1; byte < bytes; ++byte) {
      length = length << 8 | static_cast<unsigned char>(head[static_cast<std::size_t>(byte)]);
    }
    if (length > static_cast<std::uint64_t>(file_->size_bytes() - begin)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "a text of %d bytes at offset %d does not fit into the file", length, begin));
    }
    scanner_.MoveTo(begin + bytes + static_cast<std::int64_t>(length));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
