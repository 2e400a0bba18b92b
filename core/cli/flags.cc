#include "core/cli/flags.h"

#include <ostream>

namespace isoscope::cli {

absl::StatusOr<std::string> ParseText(absl::string_view text) {
  if (text.empty()) {
    return absl::InvalidArgumentError("is empty");
  }
  return std::string(text);
}

void AddQuietFlag(FlagSet* set, bool* is_quiet) {
  set->AddSwitch("-q,--quiet", is_quiet, "say nothing unless something is wrong");
}

Context QuietContext(const Context& context) {
  static std::ostream& nowhere = *new std::ostream(nullptr);
  Context quiet = context;
  quiet.out = &nowhere;
  quiet.err_is_terminal = false;
  quiet.out_columns = 0;
  return quiet;
}

}  // namespace isoscope::cli
