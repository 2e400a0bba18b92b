// The suffix of an output file, and the format that it implies.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// UsageError if the name of `path` has another suffix than `suffix` (".png"; case does not matter),
// because it implies a format that is not written. A name without a suffix, a device or a pipe
// implies none. `formats`: all that are written, as the error lists them: ".png, .jpg".
absl::Status CheckSuffix(const std::string& path, absl::string_view suffix,
                         absl::string_view formats);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_
