// Messages as JSON, by protobuf's mapping: lowerCamelCase, int64 as text.

#ifndef ISOSCOPE_WEB_GATEWAY_API_JSON_H_
#define ISOSCOPE_WEB_GATEWAY_API_JSON_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "google/protobuf/message.h"

namespace isoscope::gateway {

// One line, without its end. Fields with their default value are left out.
std::string ToJson(const google::protobuf::Message& message);

// The same with other characters than ASCII as \uXXXX, for a header of HTTP.
std::string ToAsciiJson(const google::protobuf::Message& message);

// The shortest decimal that reads back as the same finite number.
std::string ToJson(double number);

// INVALID_ARGUMENT, with the name of the message: no JSON, a field that there is not, or a value of
// another type.
absl::Status FromJson(absl::string_view json, google::protobuf::Message* message);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_JSON_H_
