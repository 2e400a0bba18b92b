// Text of others, such as a server's message or a name in a file, made harmless for a terminal.
//
// A control character among it could move the cursor, change the title, or hide text.

#ifndef ISOSCOPE_CORE_BASE_PRINTABLE_H_
#define ISOSCOPE_CORE_BASE_PRINTABLE_H_

#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::base {

// `text` as one line of UTF-8 without control characters. White space among them (a tab, a line
// feed, a carriage return or the pair of both) becomes one space. Each other one, be it of ASCII or
// U+0080 to U+009F, and each byte that is no UTF-8, becomes '?'.
std::string Printable(absl::string_view text);

// The same with one '?' for each byte beyond ASCII, too: a byte is a column.
std::string PrintableAscii(absl::string_view text);

// The JSON of the same value, in whose strings U+007F to U+009F stand as \u007f. Those below U+0020
// are escaped in any JSON.
std::string PrintableJson(absl::string_view json);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_PRINTABLE_H_
