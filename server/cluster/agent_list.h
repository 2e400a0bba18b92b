// Agent targets that are files. "file:PATH" stands for the agents in a list. The list is read again
// at every poll, so agents can be added or removed without a restart and without DNS.

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

// Reads a list: one HOST[:PORT] or gRPC target a line. Empty lines and text after a '#' are
// ignored. Returns the targets, ascending, each once; at least one. INVALID_ARGUMENT: the list is
// empty, or a line has a target with a blank, or one that stands for several agents. Errors of the
// disk as io::ReadWholeFile.
absl::StatusOr<std::vector<std::string>> ReadAgentList(const std::string& path);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_LIST_H_
