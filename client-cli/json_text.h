// JSON as commands print it.

#ifndef ISOSCOPE_CLIENT_CLI_JSON_TEXT_H_
#define ISOSCOPE_CLIENT_CLI_JSON_TEXT_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

namespace isoscope::cli {

// Indented by two, with a final line feed. JSON is UTF-8, and names of files may be any bytes:
// those that are not UTF-8 become U+FFFD. No control character stands in it (base::PrintableJson).
std::string JsonText(const nlohmann::ordered_json& json);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_JSON_TEXT_H_
