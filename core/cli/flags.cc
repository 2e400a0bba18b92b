#include "core/cli/flags.h"

#include <ostream>

#include "core/cli/progress_line.h"

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
  thread_local std::ostream nowhere(nullptr);
  Context quiet = WithoutProgress(context);
  quiet.out = &nowhere;
  quiet.out_columns = 0;
  return quiet;
}

}  // namespace isoscope::cli
