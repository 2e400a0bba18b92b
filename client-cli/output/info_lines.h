// The parts that the lines of `info` are made of. Text of JSON passes through base::Printable: names
// and messages come from servers and files.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_INFO_LINES_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_INFO_LINES_H_

#include <string>

#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

namespace isoscope::cli {

using Json = nlohmann::ordered_json;

// Returns null for "".
Json TextOrNull(const std::string& text);
// Returns a text member for the user; "" of null.
std::string TextOf(const Json& object, const char* key);
// Returns the numbers of an array, as in "1 x 2 x 3".
std::string Joined(const Json& array, absl::string_view separator);
// Appends a line; values begin in one column.
void AddLine(absl::string_view name, absl::string_view value, std::string* text);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_INFO_LINES_H_
