// Connections between programs: TLS with certificates on both sides, or plaintext on one machine.
// This header has the flags with the files' names, the checks before the start, and gRPC's
// credentials.
//
// All parties have certificates of one private authority (CA). A URI among the alternative names of
// a certificate states the role of its holder: "isoscope:role:coordinator". docs/security.md
// describes the scheme.
//
// gRPC reads the files again when they change: existing connections continue, later ones use the
// new certificates.

#ifndef ISOSCOPE_RPC_TRANSPORT_H_
#define ISOSCOPE_RPC_TRANSPORT_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace grpc {  // NOLINT(readability-identifier-naming): theirs
class ChannelCredentials;
class ServerCredentials;
}  // namespace grpc

namespace isoscope::rpc {

// The roles of certificates. The names are a contract with those that sign them.
inline constexpr absl::string_view kAgentRole = "agent";
inline constexpr absl::string_view kCoordinatorRole = "coordinator";
inline constexpr absl::string_view kGatewayRole = "gateway";
inline constexpr absl::string_view kClientRole = "client";
// Before the role in the URI.
inline constexpr absl::string_view kRolePrefix = "isoscope:role:";

// The flags of a command line about connections.
struct TransportFlags {
  std::string certificate_file = {};  // --tls-cert: own chain, PEM
  std::string key_file = {};          // --tls-key: its key, PEM
  std::string ca_file = {};           // --tls-ca: who must have signed the peers', PEM
  // --tls-server-name: the name that the dialled server's certificate must bear; empty: that of its
  // address.
  std::string server_name = {};
  bool is_insecure = false;  // --insecure: plaintext may leave this machine

  [[nodiscard]] bool has_tls() const { return !ca_file.empty() || !certificate_file.empty(); }
};

// Whether a gRPC target, or HOST:PORT, stays on this machine: a socket of the file system,
// 127.x.y.z, ::1 or localhost.
bool IsLoopbackTarget(absl::string_view target);

// Checks the flags of a program that listens. INVALID_ARGUMENT: only some of the three files are
// given, or it would serve plaintext beyond this machine without --insecure.
absl::Status CheckListen(const TransportFlags& flags, absl::string_view listen_address);
// Checks the flags of a program that dials. INVALID_ARGUMENT: a certificate without its key or
// without a CA; --tls-server-name without TLS.
absl::Status CheckDialFlags(const TransportFlags& flags);
// The same; also if `peer` ("the agent") would be dialled in plaintext beyond this machine without
// --insecure.
absl::Status CheckDial(const TransportFlags& flags, absl::string_view peer,
                       absl::string_view target);

// Reads the files that the flags name. NOT_FOUND, PERMISSION_DENIED or INVALID_ARGUMENT names the
// file: it can't be read, is no PEM, the key is another certificate's. FAILED_PRECONDITION: the
// certificate has expired or is not valid yet, or it lacks `own_role` ("": any will do).
absl::Status CheckFiles(const TransportFlags& flags, absl::string_view own_role);

// The first name (DNS) that the certificate of a file bears; "" if it has none, or can't be read.
std::string FirstNameOf(const std::string& certificate_file);

// Whether a server requires a certificate of its peers.
enum class PeerCertificate {
  kRequired,  // the handshake fails without one
  kIfShown,   // checked if there is one; calls decide
};
// Null without TLS. If `required_role` is not empty, calls of peers without it end with
// PERMISSION_DENIED, except those for health. Errors as CheckFiles.
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(
    const TransportFlags& flags, absl::string_view own_role, PeerCertificate peer_certificate,
    absl::string_view required_role);

// How channels are made. Copies share their credentials.
struct Dialing {
  std::shared_ptr<grpc::ChannelCredentials> credentials = nullptr;  // null: plaintext
  // The name that the server's certificate must bear; empty: that of the target.
  std::string server_name = {};
};
// Errors as CheckFiles. `own_role`: checked if the flags have a certificate. `server_role`: the
// role that the server's certificate must have, beside its name; without it the handshake fails.
// Empty: any will do.
absl::StatusOr<Dialing> MakeDialing(const TransportFlags& flags, absl::string_view own_role,
                                    absl::string_view server_role = "");

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_TRANSPORT_H_
