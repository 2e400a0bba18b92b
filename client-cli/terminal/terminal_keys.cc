// A special key begins with ESC: "ESC O A" or "ESC [ A" is an arrow, "ESC [ 1 ; 2 A" one with
// Shift. After a lone ESC the reader waits for the next byte.

#include "client-cli/terminal/terminal_keys.h"

#include <cstddef>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace isoscope::cli {
namespace {

constexpr char kEscape = '\x1B';
// Longer sequences are no keys.
constexpr std::size_t kMaxSequence = 32;

std::optional<Key::Kind> KindOf(char final_byte) {
  switch (final_byte) {
    case 'A':
      return Key::Kind::kUp;
    case 'B':
      return Key::Kind::kDown;
    case 'C':
      return Key::Kind::kRight;
    case 'D':
      return Key::Kind::kLeft;
    case 'H':
      return Key::Kind::kHome;
    default:
      return std::nullopt;
  }
}

// Returns the size of the sequence at the begin of `text`, which begins with ESC; 0 if it is
// incomplete.
std::size_t SequenceSize(absl::string_view text) {
  if (text.size() < 2) {
    return 0;
  }
  if (text[1] == 'O') {
    return text.size() < 3 ? 0 : 3;
  }
  if (text[1] != '[') {
    return 1;  // Escape, and then another key
  }
  const std::size_t final_byte = text.find_first_not_of("0123456789;?<", 2);
  if (final_byte == absl::string_view::npos) {
    return text.size() > kMaxSequence ? text.size() : 0;
  }
  return final_byte + 1;
}

}  // namespace

std::vector<Key> KeyReader::Take(absl::string_view bytes) {
  absl::StrAppend(&pending_, bytes);
  std::vector<Key> keys;
  absl::string_view rest = pending_;
  while (!rest.empty()) {
    if (rest[0] != kEscape) {
      if (static_cast<unsigned char>(rest[0]) < 128) {
        keys.push_back({.kind = Key::Kind::kCharacter, .character = rest[0]});
      }
      rest.remove_prefix(1);
      continue;
    }
    const std::size_t size = SequenceSize(rest);
    if (size == 0) {
      break;
    }
    const absl::string_view sequence = rest.substr(0, size);
    if (const std::optional<Key::Kind> kind = KindOf(sequence.back()); size > 1 && kind) {
      keys.push_back(
          {.kind = *kind, .character = 0, .has_shift = absl::StrContains(sequence, ";2")});
    } else if (sequence == "\x1B[1~" || sequence == "\x1B[7~") {
      keys.push_back({.kind = Key::Kind::kHome});
    }
    rest.remove_prefix(size);
  }
  pending_ = std::string(rest);
  return keys;
}

}  // namespace isoscope::cli
