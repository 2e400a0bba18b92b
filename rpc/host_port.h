// Addresses as users write them.

#ifndef ISOSCOPE_RPC_HOST_PORT_H_
#define ISOSCOPE_RPC_HOST_PORT_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::rpc {

// "HOST:PORT", port 0 to 65535; an IPv6 address in brackets. Returns the text. INVALID_ARGUMENT
// quotes it and says what is allowed.
absl::StatusOr<std::string> ParseHostPort(absl::string_view text);

// The port of an address that names none.
constexpr int kCoordinatorPort = 50051;
constexpr int kAgentPort = 50052;
constexpr int kGatewayPort = 8080;

// Returns "HOST" and "[IPV6]" with the port, all other texts and gRPC targets as they are. A number
// alone is no host: the user probably meant a port.
std::string WithDefaultPort(absl::string_view text, int port);

// As ParseHostPort, and takes "HOST" alone, which gets the port.
absl::StatusOr<std::string> ParseAddress(absl::string_view text, int default_port);
// The same for a coordinator.
absl::StatusOr<std::string> ParseCoordinatorAddress(absl::string_view text);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_HOST_PORT_H_
