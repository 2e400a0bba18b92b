#include "client-cli/output/output_suffix.h"

#include <filesystem>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/cli/usage.h"
#include "core/io/atomic_file.h"

namespace isoscope::cli {

absl::Status CheckSuffix(const std::string& path, absl::string_view suffix,
                         absl::string_view formats) {
  const std::filesystem::path name(path);
  const std::string actual = name.extension().string();
  if (actual.empty() || absl::EqualsIgnoreCase(actual, suffix) || io::IsSpecialFile(path)) {
    return absl::OkStatus();
  }
  return UsageError(absl::StrCat("--output '", path, "': the suffix '", actual,
                                 "' is of no format that is written: ", formats, "; expected '",
                                 name.stem().string(), suffix, "'"));
}

}  // namespace isoscope::cli
