// Addresses as people write them.

#ifndef ISOSCOPE_CORE_RPC_HOST_PORT_H_
#define ISOSCOPE_CORE_RPC_HOST_PORT_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::rpc {

// "HOST:PORT", port 0 to 65535; an IPv6 address in brackets. Returns the text. INVALID_ARGUMENT
// quotes it and says what is allowed.
absl::StatusOr<std::string> ParseHostPort(absl::string_view text);

// Of a coordinator, where an address names none.
constexpr int kDefaultCoordinatorPort = 50051;

// The address of a coordinator: as ParseHostPort, or "HOST" alone, which gets the default port.
absl::StatusOr<std::string> ParseCoordinatorAddress(absl::string_view text);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_HOST_PORT_H_
