// A header of an answer, by name.

#ifndef ISOSCOPE_TESTS_UNIT_WEB_GATEWAY_HEADER_OF_H_
#define ISOSCOPE_TESTS_UNIT_WEB_GATEWAY_HEADER_OF_H_

#include <string>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

// The value of the first header of that name, letters of any case; "" without one.
inline std::string HeaderOf(const HttpResponse& response, absl::string_view name) {
  for (const auto& [known, value] : response.headers) {
    if (absl::EqualsIgnoreCase(known, name)) {
      return value;
    }
  }
  return "";
}

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_TESTS_UNIT_WEB_GATEWAY_HEADER_OF_H_
