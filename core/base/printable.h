// Text of others, such as a server's message, a name in a request or in a file, made harmless.
//
// It may be long, and hold characters that move a cursor, end a line, turn text around, or hide it.
// So it is bounded before it is kept, logged or answered, and shown without such characters:
//
//   at a terminal                   Printable, PrintableAscii: '?' stands for each
//   in a log, in an error           Escaped, Quoted: \u001b
//   in JSON                         JsonString, PrintableJson: \u001b
//   kept, for a log or a page       ForeignText

#ifndef ISOSCOPE_CORE_BASE_PRINTABLE_H_
#define ISOSCOPE_CORE_BASE_PRINTABLE_H_

#include <cstddef>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Bytes of a text of others that are kept, logged or answered.
inline constexpr std::size_t kMaxForeignBytes = 256;

// `text` if it has at most `max_bytes`; else its first whole characters of at most `max_bytes`, and
// "... (cut, N bytes)" with the bytes of `text`.
std::string CutText(absl::string_view text, std::size_t max_bytes = kMaxForeignBytes);

// A text of others that is bounded when it is kept: CutText.
class ForeignText {
 public:
  ForeignText() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): members of this type take texts
  ForeignText(absl::string_view text) : text_(CutText(text)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  ForeignText(const std::string& text) : ForeignText(absl::string_view(text)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  ForeignText(const char* text) : ForeignText(absl::string_view(text)) {}

  [[nodiscard]] const std::string& text() const { return text_; }
  [[nodiscard]] bool empty() const { return text_.empty(); }

  friend bool operator==(const ForeignText&, const ForeignText&) = default;

 private:
  std::string text_;
};

// `text` as one line of UTF-8 without the characters above. White space among them (a tab, a line
// feed, a carriage return or the pair of both) becomes one space. Each other one becomes '?':
// control characters (U+0000 to U+001F, U+007F to U+009F), separators of lines and paragraphs
// (U+2028, U+2029), marks of the direction of text (U+061C, U+200E, U+200F, U+202A to U+202E,
// U+2066 to U+2069), tags (U+E0000 to U+E007F). So does each byte that is no UTF-8.
std::string Printable(absl::string_view text);

// The same with one '?' for each byte beyond ASCII, too: a byte is a column.
std::string PrintableAscii(absl::string_view text);

// `text` as UTF-8, in which each of these characters, the quotation mark '"' and the backslash are
// escaped as in C++: \n \r \t \" \\, \u001b, \U000e0001; and \xff for a byte that is no UTF-8.
std::string Escaped(absl::string_view text);

// `text` with '?' for each byte that is no UTF-8.
std::string ValidUtf8(absl::string_view text);

// Whether Escaped returns the text as it is.
bool IsPlain(absl::string_view text);

// CutText, escaped, between `mark`s: a name of a request in an error.
std::string Quoted(absl::string_view text, char mark = '"');

// `text` as a JSON string in quotation marks. U+FFFD stands for a byte that is no UTF-8.
std::string JsonString(absl::string_view text);

// The JSON of the same value, in whose strings those characters beyond U+007E are escaped. Those
// below U+0020 are escaped in any JSON.
std::string PrintableJson(absl::string_view json);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_PRINTABLE_H_
