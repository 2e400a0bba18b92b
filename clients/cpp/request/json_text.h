// JSON as the commands print it.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_JSON_TEXT_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_JSON_TEXT_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

namespace isoscope::client {

// Indented by two, with a final line feed. JSON is UTF-8, but file names may have any bytes:
// invalid ones become U+FFFD. Control characters are escaped (base::PrintableJson).
std::string JsonText(const nlohmann::ordered_json& json);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_JSON_TEXT_H_
