// The main() that isoscope-coordinator, isoscope-agent and isoscope-gateway share:
//
//   parse the command line  ->  start the server  ->  wait for SIGTERM or SIGINT  ->  drain
//
// SIGUSR1 and SIGUSR2 change the level of the log meanwhile.
//
// Each program adds its own flags and its start function. The exit code is 0 after a shutdown,
// --help or --version; 2 for wrong usage, such as plaintext beyond this machine without --insecure;
// 1 if the server could not start, with one line on standard error.
//
// With --probe the program starts nothing: it asks a running server whether it serves, prints one
// line, and exits with 0 or 1.

#ifndef ISOSCOPE_RPC_SERVER_PROGRAM_H_
#define ISOSCOPE_RPC_SERVER_PROGRAM_H_

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/cli/flag_set.h"
#include "rpc/server_flags.h"

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
  bool is_grpc_server = true;  // has --max-concurrent-frames, --max-queued-frames, --reflection
  bool dials = false;          // has --tls-server-name
  // Adds the program's own flags.
  std::function<void(cli::FlagSet* set)> add_flags;
  // Returns an error for wrong usage that no single flag shows; it calls CheckListen, as null does.
  std::function<absl::Status(const ServerFlags& flags)> check = nullptr;
  // Returns OK if the server at `address` serves; null: ProbeHealth with the program's own flags.
  std::function<absl::Status(const ServerFlags& flags, const std::string& address)> probe = nullptr;
  // Called on SIGTERM, before the shutdown. Tells other programs that this server will stop, and
  // returns the time that they need. The server still serves meanwhile. Null: no other program
  // needs to know.
  std::function<absl::Duration()> announce_drain = nullptr;
  // Starts the server once all flags are read, and logs that it serves, unless `finish_start` does.
  // Returns an empty function if the flags asked for other work, which is then done. A signal
  // meanwhile ends the process at once, with 0.
  std::function<absl::StatusOr<ServerShutdown>(const ServerFlags& flags)> start;
  // The rest of the start, if that takes long: it runs on a thread of its own while the server
  // answers already. An error ends the program as one of `start` does. It heeds `cancellation`,
  // which a signal fires; if it stands still then, the process ends without it. Null: none.
  std::function<absl::Status(const base::Cancellation& cancellation)> finish_start = nullptr;
};

// Runs `program` and returns its exit code. Call from main(), before any thread runs.
int RunServerProgram(const ServerProgram& program, int argc, char** argv);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_SERVER_PROGRAM_H_
