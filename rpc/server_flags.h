// The flags that all servers' command lines have.

#ifndef ISOSCOPE_RPC_SERVER_FLAGS_H_
#define ISOSCOPE_RPC_SERVER_FLAGS_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "rpc/health_probe.h"
#include "rpc/transport.h"

namespace isoscope::rpc {

struct ServerFlags {
  std::string listen_address;  // --listen, "HOST:PORT"
  int max_concurrent_frames = 4;
  int max_queued_frames = 0;
  double drain_seconds = 30;
  std::string log_level = "info";   // "debug", "info", "warning", "error" or "off"
  std::string log_format = "text";  // "text" or "json"
  TransportFlags transport = {};
  bool has_reflection = true;       // --reflection; programs without gRPC servers ignore it
  bool is_probe = false;            // --probe: ask a server whether it serves, and end
  Probe probe = Probe::kReady;      // of --probe: what is asked
  std::string probe_address = {};   // of --probe; empty: listen_address
  std::string metrics_listen = {};  // --metrics-listen, "HOST:PORT" or a port; empty: no metrics
};

// Adds the flags, each with its environment variable. `flags` holds the defaults and must outlive
// the parsing.
//
// is_grpc_server: whether the program has the two limits of frames, and reflection
// dials:          whether it is a client of other servers
void AddServerFlags(cli::FlagSet* set, ServerFlags* flags, bool is_grpc_server, bool dials);

// Adds --tls-cert, --tls-key, --tls-ca and --insecure, for commands that are servers, too.
// `has_server_name`: and --tls-server-name, for those that dial others.
void AddTransportFlags(cli::FlagSet* set, TransportFlags* flags, bool has_server_name);

// Reads the value of --probe: "", or "ready" or "live", or HOST:PORT, or "live,HOST:PORT".
absl::Status ParseProbe(absl::string_view text, ServerFlags* flags);

// Returns `listen_address` with the bound port instead of its own, for a log line.
std::string BoundAddress(absl::string_view listen_address, int port);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_SERVER_FLAGS_H_
