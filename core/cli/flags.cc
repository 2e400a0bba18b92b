#include "core/cli/flags.h"

namespace isoscope::cli {

absl::StatusOr<std::string> ParseText(absl::string_view text) {
  if (text.empty()) {
    return absl::InvalidArgumentError("is empty");
  }
  return std::string(text);
}

}  // namespace isoscope::cli
