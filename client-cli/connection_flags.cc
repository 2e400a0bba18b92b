#include "client-cli/connection_flags.h"

#include <cstdlib>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/rpc/peer.h"

namespace isoscope::cli {
namespace {

constexpr char kTokenVariable[] = "ISOSCOPE_TOKEN";

}  // namespace

void AddConnectionFlags(CLI::App* app, ConnectionFlags* flags) {
  rpc::TransportFlags* const transport = &flags->transport;
  app->add_option("--tls-ca", transport->ca_file,
                  "the authority that must have signed the server's certificate, PEM: speak TLS")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_CA");
  app->add_option("--tls-cert", transport->certificate_file, "own certificate, PEM")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_CERT");
  app->add_option("--tls-key", transport->key_file, "its private key, PEM")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_KEY");
  app->add_option("--tls-server-name", transport->server_name,
                  "the name in the server's certificate, where it is not that of the address")
      ->type_name("NAME")
      ->envname("ISOSCOPE_TLS_SERVER_NAME");
  app->add_option("--token-file", flags->token_file,
                  "a file with the token to send to the server (default: $ISOSCOPE_TOKEN, the "
                  "token itself)")
      ->type_name("FILE");
  app->add_flag("--insecure", transport->is_insecure,
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
  if (!flags.transport.has_tls() && !flags.transport.is_insecure &&
      !rpc::IsLoopbackTarget(server)) {
    return UsageError(absl::StrCat("the token would go to ", server,
                                   " in plaintext: give --tls-ca FILE, or --insecure where the "
                                   "way there is safe by other means"));
  }
  return token;
}

}  // namespace isoscope::cli
