// The colour names of CSS.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_COLOR_NAMES_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_COLOR_NAMES_H_

#include <cstdint>
#include <optional>

#include "absl/strings/string_view.h"

namespace isoscope::client {

// Returns 0xRRGGBB of a named colour of CSS Color Module Level 4, ignoring case; nullopt for
// another word.
std::optional<std::uint32_t> NamedColor(absl::string_view name);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_COLOR_NAMES_H_
