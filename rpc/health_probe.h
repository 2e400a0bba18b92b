// Asks a server of ours whether it serves, by grpc.health.v1: the --probe of all programs.

#ifndef ISOSCOPE_RPC_HEALTH_PROBE_H_
#define ISOSCOPE_RPC_HEALTH_PROBE_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "rpc/transport.h"

namespace isoscope::rpc {

enum class Probe {
  kReady,  // whether it takes calls of clients: SERVING
  kLive,   // whether it answers at all
};

// OK if the server is ready or live, as asked. UNAVAILABLE: it is not, or no server answers; other
// errors of the call.
absl::Status ProbeHealth(const std::string& address, const Dialing& dialing, absl::Duration timeout,
                         Probe probe = Probe::kReady);

// Returns the address at which the own machine reaches a server that listens on `listen_address`:
// "0.0.0.0:1" is "127.0.0.1:1".
std::string OwnAddress(absl::string_view listen_address);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_HEALTH_PROBE_H_
