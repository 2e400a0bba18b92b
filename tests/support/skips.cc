#include "tests/support/skips.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace isoscope::testing {

bool IsRequired(absl::string_view reason, const char* required) {
  const std::vector<std::string> names =
      absl::StrSplit(required == nullptr ? "" : required, ',', absl::SkipWhitespace());
  return std::any_of(names.begin(), names.end(),
                     [&](const std::string& name) { return name == "all" || name == reason; });
}

bool NoteSkip(absl::string_view reason, absl::string_view message) {
  // NOLINTBEGIN(concurrency-mt-unsafe): no thread sets the environment
  const char* const path = std::getenv("ISOSCOPE_SKIPS");
  const char* const required = std::getenv("ISOSCOPE_REQUIRE");
  // NOLINTEND(concurrency-mt-unsafe)
  if (path != nullptr && *path != '\0') {
    std::string line = absl::StrCat(reason, "\t", message);
    std::replace(line.begin(), line.end(), '\n', ' ');
    // One write, so that lines of several programs do not mix.
    std::ofstream(path, std::ios::app) << absl::StrCat(line, "\n");
  }
  return IsRequired(reason, required);
}

}  // namespace isoscope::testing
