// The entry point of the client: connects to an address, with TLS files and a token.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_CONNECT_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_CONNECT_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/connection/service_client.h"
#include "core/cli/interrupt.h"
#include "rpc/transport.h"

namespace isoscope::client {

struct ConnectOptions {
  std::string address;  // HOST:PORT of a coordinator, or of `isoscope serve`
  // `ca_file` switches TLS on. gRPC reads the files again when they change.
  rpc::TransportFlags transport = {};
  // Sent with each call; at most one of the two. Both empty: none.
  std::string token = {};
  std::string token_file = {};
};

// Returns true if a token may be sent to `address`: in plaintext only on this machine, unless the
// flags allow insecure connections.
bool MaySendToken(const rpc::TransportFlags& transport, absl::string_view address);

// The channel connects at the first call, so an unreachable server is an error of that call.
//
// `interrupt`: outlives the client; null: calls end with their timeouts only.
//
// INVALID_ARGUMENT: the address, the combination of files, the token, or a token that would leave
// this machine in plaintext. NOT_FOUND, PERMISSION_DENIED, FAILED_PRECONDITION: errors of the
// files. Thread-safe.
absl::StatusOr<std::unique_ptr<ServiceClient>> Connect(const ConnectOptions& options,
                                                       cli::Interrupt* interrupt = nullptr);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_CONNECT_H_
