// `isoscope info DIR.partial`: how far the parts of a dataset are, on all machines.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_PARTS_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_PARTS_H_

#include <string>

#include "absl/status/statusor.h"

#include "client-cli/output/info_lines.h"

namespace isoscope::cli {

// Whether parts of a dataset lie at `path`: "DIR.partial", or DIR as long as it does not exist.
bool HoldsParts(const std::string& path);

// {"parts": {"dataset", "directory", "part_count", "volume_count", "finished_count", "parts":
// [{"part", "state", "finished_volume_count", "percent", "host", "process_id",
// "seconds_since_news"}]}}; state is "finished", "running", "silent" (no news for a minute) or
// "waiting". The last four members are of parts that are running or silent. Errors as
// partition::ReadPartsState.
absl::StatusOr<Json> DescribeParts(const std::string& path);

// The text for users, from the JSON above.
std::string PartsText(const Json& json);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_PARTS_H_
