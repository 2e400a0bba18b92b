// The flags that all servers' command lines have.

#ifndef ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_
#define ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_

#include <string>

#include "absl/strings/string_view.h"
#include <CLI/CLI.hpp>

namespace isoscope::rpc {

struct ServerFlags {
  std::string listen_address;  // --listen, "HOST:PORT"
  int max_concurrent_frames = 4;
  int max_queued_frames = 0;
  double drain_seconds = 30;
  std::string metrics_listen = {};  // --metrics-listen, "HOST:PORT" or a port; empty: no metrics
  std::string log_level = "info";   // "debug", "info", "warning", "error" or "off"
};

// Adds the flags, each with its environment variable. `flags` holds the defaults and must outlive
// the parsing. has_frame_flags: whether the program has the two limits of frames.
void AddServerFlags(CLI::App* app, ServerFlags* flags, bool has_frame_flags);

// Returns `listen_address` with the bound port instead of its own, for a log line.
std::string BoundAddress(absl::string_view listen_address, int port);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_SERVER_FLAGS_H_
