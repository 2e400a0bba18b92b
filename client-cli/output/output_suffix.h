// The suffix of a file that is written, and the format that the suffix promises.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// UsageError if the name of `path` has another suffix than `suffix` (".png"; letters of any case):
// it would promise a format that is not written. A name without a suffix promises nothing, nor does
// a device or a pipe. `format` says what is written: "PNG".
absl::Status CheckSuffix(const std::string& path, absl::string_view suffix,
                         absl::string_view format);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_OUTPUT_SUFFIX_H_
