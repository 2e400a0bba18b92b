// Agent targets that are files. "file:PATH" stands for the agents in a list, which is read again at
// every poll: so agents come and go without a restart where no DNS follows them.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_LIST_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_LIST_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::server {

// Returns PATH of "file:PATH"; none for other targets. INVALID_ARGUMENT: the path is empty.
absl::StatusOr<std::optional<std::string>> ParseAgentListTarget(absl::string_view target);

// Reads a list: one HOST[:PORT] or gRPC target a line; empty lines, and what follows a '#', do not
// count. Returns the targets, ascending, each once; at least one. INVALID_ARGUMENT: there is none;
// or, with its line, a blank in a target, or one that stands for several agents. Errors of the disk
// as io::ReadWholeFile.
absl::StatusOr<std::vector<std::string>> ReadAgentList(const std::string& path);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_LIST_H_
