// From members of JSON to the lines of text that people read: what all output of `info` shares.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_JSON_LINES_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_JSON_LINES_H_

#include <string>

#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

#include "client-cli/output/dataset_json.h"

namespace isoscope::cli {

// Returns null for "".
Json TextOrNull(const std::string& text);

// "1 x 2 x 3": the numbers of an array, joined.
std::string Joined(const Json& array, absl::string_view separator);

// A text member made printable, "" of null: names and messages come from servers and files.
std::string Text(const Json& object, const char* key);

// Appends a line: the name, padded to the column of values, and the value.
void AddLine(absl::string_view name, const std::string& value, std::string* text);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_JSON_LINES_H_
