#include "client-cli/output/json_lines.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <nlohmann/json.hpp>

#include "core/base/printable.h"

namespace isoscope::cli {

Json TextOrNull(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

std::string Joined(const Json& array, absl::string_view separator) {
  return absl::StrJoin(array, separator, [](std::string* out, const Json& element) {
    // As JSON, an infinite number is null.
    const bool is_infinite = element.is_number_float() && std::isinf(element.get<double>());
    absl::StrAppend(out, is_infinite ? absl::StrCat(element.get<double>()) : element.dump());
  });
}

std::string Text(const Json& object, const char* key) {
  const Json& value = object.at(key);
  return value.is_string() ? base::Printable(value.get<std::string>()) : std::string();
}

void AddLine(absl::string_view name, const std::string& value, std::string* text) {
  absl::StrAppend(text, name, std::string(14 - name.size(), ' '), value, "\n");
}

}  // namespace isoscope::cli
