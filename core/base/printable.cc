// All functions walk a text character by character. FirstOf decodes one, or marks one byte as no
// UTF-8 (RFC 3629). Then each function copies, escapes or replaces it.
//
// Steering characters (kSteering) are never copied as they are:
//
//   0 to 1f, 7f to 9f          control characters: cursors, colours, ends of lines
//   61c, 200e to 200f,
//   202a to 202e, 2066 to 2069 marks of the direction of text, which can turn a name around
//   2028, 2029                 separators of lines and paragraphs
//   e0000 to e007f             tags, which no font shows
//
// Example: "a\x1b[2Jb" is "a?[2Jb" from Printable and "a\u001b[2Jb" from Escaped.

#include "core/base/printable.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
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

// Characters that steer whoever shows them: a terminal, a pager, a browser. First and last of each
// range, ascending.
struct SteeringRange {
  char32_t first;
  char32_t last;
};
constexpr std::array<SteeringRange, 8> kSteering = {{{0, 0x1f},
                                                     {0x7f, 0x9f},
                                                     {0x61c, 0x61c},
                                                     {0x200e, 0x200f},
                                                     {0x2028, 0x2029},
                                                     {0x202a, 0x202e},
                                                     {0x2066, 0x2069},
                                                     {0xe0000, 0xe007f}}};

bool IsSteering(char32_t code) {
  return std::any_of(kSteering.begin(), kSteering.end(), [code](const SteeringRange& range) {
    return code >= range.first && code <= range.last;
  });
}

bool IsWhiteSpace(char c) { return c == '\t' || c == '\n' || c == '\r'; }

bool NeedsEscape(const Character& character) {
  return !character.is_valid || character.code == '"' || character.code == '\\' ||
         IsSteering(character.code);
}

// As JSON and C++ write it: \n \r \t \" \\, \u001b. REQUIRES: code < 0x10000
void AppendShortEscape(char32_t code, std::string* out) {
  switch (code) {
    case '\n':
      out->append("\\n");
      break;
    case '\r':
      out->append("\\r");
      break;
    case '\t':
      out->append("\\t");
      break;
    case '"':
    case '\\':
      out->push_back('\\');
      out->push_back(static_cast<char>(code));
      break;
    default:
      absl::StrAppendFormat(out, "\\u%04x", static_cast<unsigned>(code));
  }
}

// JSON has no longer escapes: two of UTF-16 stand for one beyond U+FFFF.
void AppendJsonEscape(const Character& character, std::string* out) {
  if (!character.is_valid) {
    out->append("\\ufffd");
  } else if (character.code < 0x10000) {
    AppendShortEscape(character.code, out);
  } else {
    const char32_t rest = character.code - 0x10000;
    AppendShortEscape(0xd800 + (rest >> 10U), out);
    AppendShortEscape(0xdc00 + (rest & 0x3ffU), out);
  }
}

}  // namespace

std::string CutText(absl::string_view text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) {
    return std::string(text);
  }
  // Of a character that would be cut, the first byte is at most three bytes before the cut.
  constexpr std::size_t kMaxLaterBytes = 3;
  std::size_t end = max_bytes;
  for (std::size_t back = 1; back <= std::min(kMaxLaterBytes, max_bytes); ++back) {
    const Character character = FirstOf(text.substr(max_bytes - back));
    if (character.is_valid) {
      end = character.size > back ? max_bytes - back : max_bytes;
      break;
    }
  }
  return absl::StrCat(text.substr(0, end), "... (cut, ", text.size(), " bytes)");
}

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
    if (!character.is_valid || IsSteering(character.code)) {
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

std::string Escaped(absl::string_view text) {
  std::string escaped;
  escaped.reserve(text.size());
  while (!text.empty()) {
    const Character character = FirstOf(text);
    if (!NeedsEscape(character)) {
      escaped.append(text.data(), character.size);
    } else if (!character.is_valid) {
      absl::StrAppendFormat(&escaped, "\\x%02x", static_cast<unsigned char>(text[0]));
    } else if (character.code < 0x10000) {
      AppendShortEscape(character.code, &escaped);
    } else {
      absl::StrAppendFormat(&escaped, "\\U%08x", static_cast<unsigned>(character.code));
    }
    text.remove_prefix(character.size);
  }
  return escaped;
}

std::string ValidUtf8(absl::string_view text) {
  std::string valid;
  valid.reserve(text.size());
  while (!text.empty()) {
    const Character character = FirstOf(text);
    if (character.is_valid) {
      valid.append(text.data(), character.size);
    } else {
      valid += kReplacement;
    }
    text.remove_prefix(character.size);
  }
  return valid;
}

bool IsPlain(absl::string_view text) {
  while (!text.empty()) {
    const Character character = FirstOf(text);
    if (NeedsEscape(character)) {
      return false;
    }
    text.remove_prefix(character.size);
  }
  return true;
}

std::string Quoted(absl::string_view text, char mark) {
  const absl::string_view marks(&mark, 1);
  return absl::StrCat(marks, Escaped(CutText(text)), marks);
}

std::string JsonString(absl::string_view text) {
  std::string json = "\"";
  json.reserve(text.size() + 2);
  while (!text.empty()) {
    const Character character = FirstOf(text);
    if (NeedsEscape(character)) {
      AppendJsonEscape(character, &json);
    } else {
      json.append(text.data(), character.size);
    }
    text.remove_prefix(character.size);
  }
  json += '"';
  return json;
}

std::string PrintableJson(absl::string_view json) {
  std::string printable;
  printable.reserve(json.size());
  while (!json.empty()) {
    const Character character = FirstOf(json);
    if (character.is_valid && character.code >= 0x7f && IsSteering(character.code)) {
      AppendJsonEscape(character, &printable);
    } else {
      printable.append(json.data(), character.size);
    }
    json.remove_prefix(character.size);
  }
  return printable;
}

}  // namespace isoscope::base
