// How commands connect to a server: --tls-ca, --tls-cert, --tls-key, --tls-server-name,
// --token-file and $ISOSCOPE_TOKEN.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_CONNECTION_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_CONNECTION_FLAGS_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/cli/flag_set.h"
#include "rpc/transport.h"

namespace isoscope::cli {

struct ConnectionFlags {
  rpc::TransportFlags transport = {};
  std::string token_file = {};
};

// `flags` must outlive the parsing.
void AddConnectionFlags(FlagSet* set, ConnectionFlags* flags);

// UsageError if flags contradict each other.
absl::Status CheckUsage(const ConnectionFlags& flags);

// Returns the token of the flags or of the environment; empty if there is none. INVALID_ARGUMENT:
// the file holds no token. UsageError: it would be sent to `server` in plaintext, beyond this
// machine.
absl::StatusOr<std::string> ReadToken(const ConnectionFlags& flags, const std::string& server);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_CONNECTION_FLAGS_H_
