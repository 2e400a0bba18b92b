// The main() that isoscope-coordinator, isoscope-agent and isoscope-gateway share:
//
//   parse the command line  ->  start the server  ->  wait for SIGTERM or SIGINT  ->  drain
//
// Each program brings its own flags and its start. The exit code is 0 after a shutdown, --help or
// --version; 2 for wrong usage; 1 if the server could not start, with one line on standard error.

#ifndef ISOSCOPE_CORE_RPC_SERVER_PROGRAM_H_
#define ISOSCOPE_CORE_RPC_SERVER_PROGRAM_H_

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <CLI/CLI.hpp>

#include "core/rpc/server_flags.h"

namespace isoscope::rpc {

// Shuts a running server down: takes no new calls, waits up to `grace` for those in work, then
// cancels them. Blocks. It owns the server, which ends with it at the latest.
using ServerShutdown = std::function<void(absl::Duration grace)>;

struct ServerProgram {
  std::string name;      // "isoscope-agent"
  std::string log_name;  // "agent", for its log line "agent_stopped"
  std::string summary;   // one line of --help
  std::string examples;  // the last lines of --help, indented; end in a line feed
  ServerFlags defaults;
  bool has_frame_flags = true;  // --max-concurrent-frames and --max-queued-frames
  // Adds the program's own flags. A callback of CLI11 that throws CLI::ParseError is wrong usage.
  std::function<void(CLI::App* app)> add_flags;
  // Starts the server once all flags are read, and logs that it serves. Returns an empty function
  // if the flags asked for something else, which it has done.
  std::function<absl::StatusOr<ServerShutdown>(const ServerFlags& flags)> start;
};

// Runs `program` and returns its exit code. Call from main(), before any thread runs.
int RunServerProgram(const ServerProgram& program, int argc, char** argv);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_SERVER_PROGRAM_H_
