// The peer of a call: its certificate, and the token that the call carries.

#ifndef ISOSCOPE_RPC_PEER_H_
#define ISOSCOPE_RPC_PEER_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <grpcpp/client_context.h>
#include <grpcpp/security/auth_context.h>
#include <grpcpp/server_context.h>

namespace isoscope::rpc {

struct Peer {
  // A certificate of the authority was shown and checked.
  bool has_certificate = false;
  std::string name = {};                // of the certificate (CN), for logs and messages
  std::vector<std::string> roles = {};  // of the certificate: "agent", "coordinator", ...
  // The value of "authorization"; empty if the call has none, or several.
  std::string authorization = {};

  [[nodiscard]] bool HasRole(absl::string_view role) const;
};

// The certificate alone.
Peer PeerOf(const grpc::AuthContext& context);
// Certificate and token. For calls that came over a network or in-process.
Peer PeerOf(const grpc::ServerContextBase& context);

// For messages: "this caller's certificate, \"bench\", has the role client".
std::string Describe(const Peer& peer);

// The roles among the URIs of a certificate, in their order.
std::vector<std::string> RolesOf(const std::vector<std::string>& uris);

// The longest token.
inline constexpr std::size_t kMaxTokenBytes = 256;
// INVALID_ARGUMENT unless `token` may travel in a header: letters, digits and -._~+/=, at most
// kMaxTokenBytes. The message does not repeat it.
absl::Status CheckTokenText(absl::string_view token);
// The token in a file, without white space around it. Errors of reading; INVALID_ARGUMENT as
// CheckTokenText.
absl::StatusOr<std::string> ReadTokenFile(const std::string& path);
// Adds the token to a call. REQUIRES: CheckTokenText, or it is empty: none.
void SendToken(const std::string& token, grpc::ClientContext* context);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_PEER_H_
