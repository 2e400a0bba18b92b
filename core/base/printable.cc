#include "core/base/printable.h"

#include <cstddef>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"

namespace isoscope::base {
namespace {

constexpr char kReplacement = '?';

struct Character {
  std::size_t size = 1;  // in bytes
  char32_t code = 0;
  bool is_valid = false;
};

// Returns the first character of `text`. If that is no UTF-8 (RFC 3629), returns one byte, marked
// as not valid. REQUIRES: !text.empty().
Character FirstOf(absl::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x80) {
    return {.size = 1, .code = first, .is_valid = true};
  }
  const std::size_t size = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  if (first < 0xc2 || first > 0xf4 || text.size() < size) {
    return {};
  }
  char32_t code = first & (0x7fU >> size);
  for (std::size_t i = 1; i < size; ++i) {
    if ((byte(i) & 0xc0U) != 0x80) {
      return {};
    }
    code = code << 6U | (byte(i) & 0x3fU);
  }
  // Longer than need be, half of a pair of UTF-16, or beyond the last character.
  const bool is_wrong = (size == 3 && code < 0x800) || (size == 4 && code < 0x10000) ||
                        (code >= 0xd800 && code < 0xe000) || code > 0x10ffff;
  return is_wrong ? Character{} : Character{.size = size, .code = code, .is_valid = true};
}

bool IsControl(char32_t code) { return code < 0x20 || (code >= 0x7f && code < 0xa0); }

bool IsWhiteSpace(char c) { return c == '\t' || c == '\n' || c == '\r'; }

}  // namespace

std::string Printable(absl::string_view text) {
  std::string printable;
  printable.reserve(text.size());
  while (!text.empty()) {
    const Character character = FirstOf(text);
    if (IsWhiteSpace(text[0])) {
      printable += ' ';
      text.remove_prefix(absl::StartsWith(text, "\r\n") ? 2 : 1);
      continue;
    }
    if (!character.is_valid || IsControl(character.code)) {
      printable += kReplacement;
    } else {
      printable.append(text.data(), character.size);
    }
    text.remove_prefix(character.size);
  }
  return printable;
}

std::string PrintableAscii(absl::string_view text) {
  std::string printable = Printable(text);
  for (char& c : printable) {
    if (static_cast<unsigned char>(c) >= 0x80) {
      c = kReplacement;
    }
  }
  return printable;
}

std::string PrintableJson(absl::string_view json) {
  std::string printable;
  printable.reserve(json.size());
  while (!json.empty()) {
    const Character character = FirstOf(json);
    if (character.is_valid && character.code >= 0x7f && character.code < 0xa0) {
      absl::StrAppendFormat(&printable, "\\u%04x", static_cast<unsigned>(character.code));
    } else {
      printable.append(json.data(), character.size);
    }
    json.remove_prefix(character.size);
  }
  return printable;
}

}  // namespace isoscope::base
