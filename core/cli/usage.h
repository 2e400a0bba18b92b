// Exit codes, and the difference between wrong usage and a request that failed.

#ifndef ISOSCOPE_CORE_CLI_USAGE_H_
#define ISOSCOPE_CORE_CLI_USAGE_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// The exit codes: a contract with scripts.
enum ExitCode : int {
  kExitDone = 0,
  kExitFailed = 1,
  kExitWrongUsage = 2,
  // Plus the signal's number: 130 after Ctrl-C, as shells have it.
  kExitInterrupted = 128,
};

// An INVALID_ARGUMENT that is the fault of the command line itself, not of the request.
// `message`: what was wrong and what is allowed.
absl::Status UsageError(absl::string_view message);
// Turns a library's INVALID_ARGUMENT into a UsageError with the same message. OK and other errors
// stay as they are.
absl::Status AsUsageError(const absl::Status& status);
bool IsUsageError(const absl::Status& status);

ExitCode ExitCodeOf(const absl::Status& status);
// The one line that goes to standard error, without its end: "isoscope render: what (see 'isoscope
// render --help')" for wrong usage, else "isoscope: NOT_FOUND: what". REQUIRES: !status.ok().
std::string FormatError(absl::string_view program, absl::string_view command,
                        const absl::Status& status);

// Returns the element of `known` nearest to `typed`, or "" if none is near.
std::string NearestName(absl::string_view typed, const std::vector<std::string>& known);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_USAGE_H_
