// The name of a field, and that of a component behind it, in one text, as --field takes it:
// "velocity", "velocity:x". Both may have colons.

#ifndef ISOSCOPE_CORE_VOLUME_FIELD_NAME_H_
#define ISOSCOPE_CORE_VOLUME_FIELD_NAME_H_

#include <cstddef>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::volume {

struct FieldName {
  std::size_t field = 0;  // index
  std::string component;  // "": none is named

  friend bool operator==(const FieldName&, const FieldName&) = default;
};

// The field whose name is the whole text; else the one with the longest name in front of a colon,
// with the rest as a component. Not set if there is none.
//
// find: std::optional<std::size_t>(absl::string_view name), the index of a field of this name
template <typename Find>
std::optional<FieldName> FindFieldName(absl::string_view text, const Find& find) {
  if (const std::optional<std::size_t> field = find(text); field.has_value()) {
    return FieldName{.field = *field, .component = ""};
  }
  constexpr int kMaxColons = 64;  // that are looked at: the text may come from anybody
  std::size_t colon = text.rfind(':');
  for (int i = 0; i < kMaxColons && colon != absl::string_view::npos && colon > 0;
       ++i, colon = text.rfind(':', colon - 1)) {
    const absl::string_view component = text.substr(colon + 1);
    const std::optional<std::size_t> field = find(text.substr(0, colon));
    if (field.has_value() && !component.empty()) {
      return FieldName{.field = *field, .component = std::string(component)};
    }
  }
  return std::nullopt;
}

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_FIELD_NAME_H_
