#include "client-cli/session/connection_flags.h"

#include <cstdlib>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/connect.h"
#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "rpc/peer.h"

namespace isoscope::cli {
namespace {

constexpr char kTokenVariable[] = "ISOSCOPE_TOKEN";

}  // namespace

void AddConnectionFlags(FlagSet* set, ConnectionFlags* flags) {
  rpc::TransportFlags* const transport = &flags->transport;
  set->AddText("--tls-ca", "FILE", &transport->ca_file,
               "the authority that must have signed the server's certificate, PEM: speak TLS")
      .Environment("ISOSCOPE_TLS_CA");
  set->AddText("--tls-cert", "FILE", &transport->certificate_file, "own certificate, PEM")
      .Environment("ISOSCOPE_TLS_CERT");
  set->AddText("--tls-key", "FILE", &transport->key_file, "its private key, PEM")
      .Environment("ISOSCOPE_TLS_KEY");
  set->AddText("--tls-server-name", "NAME", &transport->server_name,
               "the name in the server's certificate, where it is not that of the address")
      .Environment("ISOSCOPE_TLS_SERVER_NAME");
  set->AddText("--token-file", "FILE", &flags->token_file,
               "a file with the token to send to the server (default: $ISOSCOPE_TOKEN, the "
               "token itself)");
  set->AddSwitch("--insecure", &transport->is_insecure,
                 "allow plaintext, and tokens in it, beyond this machine");
}

absl::Status CheckUsage(const ConnectionFlags& flags) {
  const absl::Status status = rpc::CheckDialFlags(flags.transport);
  return status.ok() ? status : UsageError(status.message());
}

absl::StatusOr<std::string> ReadToken(const ConnectionFlags& flags, const std::string& server) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
  const char* const variable = getenv(kTokenVariable);
  std::string token(absl::StripAsciiWhitespace(variable == nullptr ? "" : variable));
  if (!flags.token_file.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(token, rpc::ReadTokenFile(flags.token_file));
  } else if (token.empty()) {
    return token;
  } else if (const absl::Status checked = rpc::CheckTokenText(token); !checked.ok()) {
    return absl::InvalidArgumentError(absl::StrCat("$", kTokenVariable, ": ", checked.message()));
  }
  if (!client::MaySendToken(flags.transport, server)) {
    return UsageError(absl::StrCat("the token would go to ", server,
                                   " in plaintext: give --tls-ca FILE, or --insecure where the "
                                   "way there is safe by other means"));
  }
  return token;
}

}  // namespace isoscope::cli
