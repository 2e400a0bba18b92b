// What the two servers' command lines have in common.

#ifndef ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_
#define ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_

#include <string>

#include "absl/strings/string_view.h"
#include <CLI/CLI.hpp>

namespace isoscope::rpc {

// Adds --drain-seconds and --log-level.
void AddServerFlags(CLI::App* app, double* drain_seconds, std::string* log_level);

// Silences gRPC's own log lines, unless GRPC_VERBOSITY asks for them: what goes wrong is told by
// statuses. Call at the top of main.
void SilenceGrpcLog();

// `name` as --log-level takes it: "debug", "info", "warning", "error" or "off".
void ApplyLogLevel(absl::string_view name);

// `listen_address` with the port that was bound in place of its own: what a log line tells.
std::string BoundAddress(absl::string_view listen_address, int port);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_
