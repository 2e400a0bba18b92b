// isoscope-gateway: the page and the HTTP interface in front of a coordinator.
//
// 1. Flags are checked: addresses, the certificate for browsers, tokens, origins, limits.
// 2. A channel to the coordinator is made; the coordinator may start later.
// 3. GatewayServer starts, then the metrics server. The log has the page's address.
// 4. SIGTERM shuts the gateway down with grace.
//
// --probe does none of this: it asks a running gateway for /healthz, for container health checks.

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/flag_set.h"
#include "core/http/metrics_server.h"
#include "core/http/peer_address.h"
#include "rpc/channel.h"
#include "rpc/host_port.h"
#include "rpc/peer.h"
#include "rpc/server_program.h"
#include "web-gateway/gateway_server.h"
#include "web-gateway/health_request.h"

namespace isoscope::gateway {
namespace {

struct Flags {
  std::string server = "127.0.0.1:50051";
  std::string https_certificate_file;
  std::string https_key_file;
  bool serves_http = false;
  bool has_user_tokens = false;
  std::string token_file;
  std::string gateway_token_file;
  std::string old_token;
  bool has_no_token = false;
  std::vector<std::string> allowed_origins;
  std::vector<std::string> framing_origins;
  std::vector<std::string> trusted_proxies;
  int max_connections = GatewayLimits().max_connections;
  int max_pictures = GatewayLimits().max_pictures;
  int max_caller_meshes = GatewayLimits().max_caller_meshes;
  std::int64_t max_mesh_bytes = GatewayLimits().max_mesh_bytes;
  double max_picture_seconds = absl::ToDoubleSeconds(GatewayLimits().max_picture_duration);
};

constexpr char kExamples[] =
    R"(  isoscope-gateway --server 127.0.0.1:50051          logs the address of the page, with a token
  isoscope-gateway --gateway-token-file token          asks for the token in that file
  isoscope-gateway --server coordinator:50051 --listen 0.0.0.0:8443 --user-tokens \
    --tls-cert gateway.pem --tls-key gateway.key --tls-ca ca.pem          https and wss
  isoscope-gateway --server coordinator:50051 --listen 0.0.0.0:8080 --insecure          plain HTTP
  isoscope-gateway --allow-origin https://hub.example.org      pages of a notebook hub may ask, too
)";

// Adds the flags for the users' tokens, and for the token of the coordinator.
void AddTokenFlags(cli::FlagSet* set, Flags* flags) {
  const cli::Flag gateway_token =
      set->AddText("--gateway-token-file", "FILE", &flags->gateway_token_file,
                   "A file with the token that every request for data must show (default: "
                   "$ISOSCOPE_GATEWAY_TOKEN, the token itself; else a random one, in the "
                   "address that is logged)")
          .Environment("ISOSCOPE_GATEWAY_TOKEN_FILE");
  const cli::Flag token =
      set->AddText("--token", "TEXT", &flags->old_token,
                   "The old way to give that token, which shows it to every user of this "
                   "machine; it goes with the next version");
  const cli::Flag no_token =
      set->AddSwitch("--no-token", &flags->has_no_token,
                     "Ask for none anywhere: where a proxy in front knows who asks")
          .Environment("ISOSCOPE_NO_TOKEN");
  const cli::Flag user_tokens =
      set->AddSwitch(
             "--user-tokens", &flags->has_user_tokens,
             "Each user shows a token that the coordinator knows (its --tokens); it is passed on")
          .Environment("ISOSCOPE_USER_TOKENS");
  const cli::Flag token_file =
      set->AddText("--token-file", "FILE", &flags->token_file,
                   "A file with the token that the coordinator gets where the user shows none of "
                   "its own (default: $ISOSCOPE_TOKEN, the token itself)")
          .Environment("ISOSCOPE_TOKEN_FILE");
  set->Exclude(no_token, token);
  set->Exclude(no_token, gateway_token);
  set->Exclude(token, gateway_token);
  set->Exclude(user_tokens, token_file);
  set->Exclude(user_tokens, token);
  set->Exclude(user_tokens, gateway_token);
}

void AddFlags(cli::FlagSet* set, Flags* flags) {
  constexpr double kMaxSeconds = 86400;
  constexpr double kMinSeconds = 0.01;
  constexpr int kMaxConnections = 65536;
  constexpr double kMinMeshBytes = 1 << 20;
  constexpr double kMaxMeshBytes = 1e15;
  const auto parse_server = [flags](absl::string_view target) {
    flags->server = rpc::WithDefaultPort(target, rpc::kCoordinatorPort);
    return absl::OkStatus();
  };
  set->Add("--server", "TARGET", parse_server, "The coordinator, HOST[:PORT] or any gRPC target")
      .DefaultText(flags->server)
      .Environment("ISOSCOPE_SERVER");
  AddTokenFlags(set, flags);
  set->AddText("--https-cert", "FILE", &flags->https_certificate_file,
               "The certificate for browsers, PEM, where it is not --tls-cert: one that they "
               "know")
      .Environment("ISOSCOPE_HTTPS_CERT");
  set->AddText("--https-key", "FILE", &flags->https_key_file, "Its private key, PEM")
      .Environment("ISOSCOPE_HTTPS_KEY");
  set->AddSwitch(
         "--http", &flags->serves_http,
         "Plain HTTP for browsers, even with --tls-cert: where a proxy in front has the TLS; "
         "beyond this machine with --insecure only")
      .Environment("ISOSCOPE_HTTP");
  set->AddTexts("--allow-origin", "ORIGIN", &flags->allowed_origins,
                "Pages of this origin may ask too, as https://HOST[:PORT]; repeatable",
                /*splits_at_spaces=*/true)
      .Environment("ISOSCOPE_ALLOW_ORIGIN");
  set->AddTexts("--allow-framing", "ORIGIN", &flags->framing_origins,
                "Pages of this origin may show the page in a frame, as https://HOST[:PORT]; "
                "repeatable",
                /*splits_at_spaces=*/true)
      .Environment("ISOSCOPE_ALLOW_FRAMING");
  set->AddTexts("--trusted-proxy", "ADDRESS[/BITS]", &flags->trusted_proxies,
                "A proxy in front, whose X-Forwarded-For names the callers for the limits by "
                "address; repeatable",
                /*splits_at_spaces=*/true)
      .Environment("ISOSCOPE_TRUSTED_PROXY");
  set->AddInteger("--max-connections", &flags->max_connections, 1, kMaxConnections,
                  "Connections at work at a time, viewers included; those that wait make room")
      .Environment("ISOSCOPE_MAX_CONNECTIONS");
  set->AddInteger("--max-pictures", &flags->max_pictures, 1, kMaxConnections,
                  "Pictures, meshes and films in work at a time, viewers apart; more are refused")
      .Environment("ISOSCOPE_MAX_PICTURES");
  set->AddInteger("--max-caller-meshes", &flags->max_caller_meshes, 1, kMaxConnections,
                  "Meshes and films in work for one caller, by token, else by address; more are "
                  "refused")
      .Environment("ISOSCOPE_MAX_CALLER_MESHES");
  set->AddByteSize("--max-mesh-bytes", &flags->max_mesh_bytes, kMinMeshBytes, kMaxMeshBytes,
                   "Disk space of the meshes and films in work (TMPDIR); those that need more are "
                   "refused")
      .Environment("ISOSCOPE_MAX_MESH_BYTES");
  set->AddNumber("--max-picture-seconds", &flags->max_picture_seconds, kMinSeconds, kMaxSeconds,
                 "How long a picture, a frame of a film, or a mesh may take")
      .Environment("ISOSCOPE_MAX_PICTURE_SECONDS");
}

// Returns the certificate for browsers and its key; empty: plain HTTP.
std::pair<std::string, std::string> HttpsFiles(const Flags& flags,
                                               const rpc::ServerFlags& server_flags) {
  if (flags.serves_http) {
    return {};
  }
  return flags.https_certificate_file.empty()
             ? std::pair(server_flags.transport.certificate_file, server_flags.transport.key_file)
             : std::pair(flags.https_certificate_file, flags.https_key_file);
}

// Returns $ISOSCOPE_TOKEN, the token to send.
std::string TokenVariable() {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
  const char* const variable = getenv("ISOSCOPE_TOKEN");
  return std::string(absl::StripAsciiWhitespace(variable == nullptr ? "" : variable));
}

// The operator's tokens; empty: none.
struct Tokens {
  std::string asked = {};  // that users must show
  std::string sent = {};   // to the coordinator, for users without one
};

absl::StatusOr<Tokens> ReadTokens(const Flags& flags) {
  Tokens tokens{.asked = flags.old_token};
  if (!flags.old_token.empty()) {
    base::LogWarning("old_option", {{"option", "--token"},
                                    {"note",
                                     "it shows the token to every user of this machine: "
                                     "use --gateway-token-file or ISOSCOPE_GATEWAY_TOKEN"}});
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(tokens.asked, ReadGatewayToken(flags.gateway_token_file));
  }
  if (!flags.token_file.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(tokens.sent, rpc::ReadTokenFile(flags.token_file));
    return tokens;
  }
  const std::string variable = TokenVariable();
  if (variable.empty() || flags.has_user_tokens) {
    return tokens;
  }
  if (tokens.asked.empty() && !flags.has_no_token) {
    // Before this version the variable was the token that users must show.
    base::LogWarning("old_option",
                     {{"option", "ISOSCOPE_TOKEN"},
                      {"note",
                       "users are asked for it, as before; from the next version on it is "
                       "what the coordinator gets: call it ISOSCOPE_GATEWAY_TOKEN"}});
    tokens.asked = variable;
    return tokens;
  }
  const absl::Status checked = rpc::CheckTokenText(variable);
  if (!checked.ok()) {
    return absl::InvalidArgumentError(absl::StrCat("$ISOSCOPE_TOKEN: ", checked.message()));
  }
  tokens.sent = variable;
  return tokens;
}

absl::StatusOr<http::TrustedProxies> ProxiesOf(const Flags& flags) {
  http::TrustedProxies proxies;
  for (const std::string& text : flags.trusted_proxies) {
    const absl::Status added = proxies.Add(text);
    if (!added.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("--trusted-proxy: ", added.message()));
    }
  }
  return proxies;
}

// Returns the origins of a flag.
absl::StatusOr<std::vector<std::string>> OriginsOf(absl::string_view flag,
                                                   const std::vector<std::string>& texts) {
  std::vector<std::string> origins;
  for (const std::string& text : texts) {
    absl::StatusOr<std::string> origin = ParseOrigin(text);
    if (!origin.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(flag, ": ", origin.status().message()));
    }
    origins.push_back(*std::move(origin));
  }
  return origins;
}

absl::Status CheckUsage(const Flags& flags, const rpc::ServerFlags& server_flags) {
  ISOSCOPE_RETURN_IF_ERROR(ProxiesOf(flags).status());
  ISOSCOPE_RETURN_IF_ERROR(OriginsOf("--allow-origin", flags.allowed_origins).status());
  ISOSCOPE_RETURN_IF_ERROR(OriginsOf("--allow-framing", flags.framing_origins).status());
  if (flags.https_certificate_file.empty() != flags.https_key_file.empty()) {
    return absl::InvalidArgumentError(
        "--https-cert and --https-key belong together: give both or neither");
  }
  if (flags.has_no_token || flags.has_user_tokens) {
    const absl::StatusOr<std::string> token = ReadGatewayToken(/*file=*/"");
    if (!token.ok() || !token->empty()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "ISOSCOPE_GATEWAY_TOKEN is set, and ",
          flags.has_no_token ? "--no-token asks for none" : "--user-tokens asks for the users' own",
          ": unset one of them"));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(rpc::CheckDial(server_flags.transport, "the coordinator", flags.server));
  if (HttpsFiles(flags, server_flags).first.empty()) {
    return rpc::CheckListen({.is_insecure = server_flags.transport.is_insecure},
                            server_flags.listen_address);
  }
  return absl::OkStatus();
}

absl::Status Probe(const Flags& flags, const rpc::ServerFlags& server_flags,
                   const std::string& address) {
  return AskHealth(
      {.address = address,
       .has_tls = !HttpsFiles(flags, server_flags).first.empty(),
       .ca_file = server_flags.probe_address.empty() ? "" : server_flags.transport.ca_file});
}

absl::StatusOr<rpc::ServerShutdown> Start(const Flags& flags,
                                          const rpc::ServerFlags& server_flags) {
  GatewayOptions options;
  ISOSCOPE_ASSIGN_OR_RETURN(const rpc::Dialing dialing,
                            rpc::MakeDialing(server_flags.transport, rpc::kGatewayRole));
  options.channel = rpc::MakeChannel(flags.server, dialing);
  ISOSCOPE_ASSIGN_OR_RETURN(const Tokens tokens, ReadTokens(flags));
  options.coordinator_token = tokens.sent;
  std::tie(options.certificate_file, options.key_file) = HttpsFiles(flags, server_flags);
  options.access.has_user_tokens = flags.has_user_tokens;
  options.coordinator_address = flags.server;
  options.listen_address = server_flags.listen_address;
  ISOSCOPE_ASSIGN_OR_RETURN(options.access.allowed_origins,
                            OriginsOf("--allow-origin", flags.allowed_origins));
  ISOSCOPE_ASSIGN_OR_RETURN(options.framing_origins,
                            OriginsOf("--allow-framing", flags.framing_origins));
  ISOSCOPE_ASSIGN_OR_RETURN(options.trusted_proxies, ProxiesOf(flags));
  options.access.token = tokens.asked;
  if (tokens.asked.empty() && !flags.has_no_token && !flags.has_user_tokens) {
    options.access.token = MakeToken();
  }
  options.limits.max_connections = flags.max_connections;
  options.limits.max_pictures = flags.max_pictures;
  options.limits.max_caller_meshes = flags.max_caller_meshes;
  options.limits.max_mesh_bytes = flags.max_mesh_bytes;
  options.limits.max_picture_duration = absl::Seconds(flags.max_picture_seconds);
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<GatewayServer> server, GatewayServer::Start(options));
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::shared_ptr<http::MetricsServer> metrics,
      http::MetricsServer::StartIfAsked(server_flags.metrics_listen,
                                        [server] { return server->CollectMetrics(); }));
  base::LogInfo("gateway_started",
                {{"address", rpc::BoundAddress(server_flags.listen_address, server->port())},
                 // A token from the operator stays out of the log.
                 {"page", PageAddress(server_flags.listen_address, server->port(),
                                      tokens.asked.empty() ? options.access.token : "",
                                      !options.certificate_file.empty())},
                 {"server", flags.server},
                 {"version", base::Version()}});
  return [server = std::move(server), metrics = std::move(metrics)](absl::Duration grace) {
    server->Shutdown(grace);
  };
}

int Main(int argc, char** argv) {
  Flags flags;
  const rpc::ServerProgram program{
      .name = "isoscope-gateway",
      .log_name = "gateway",
      .summary = "Serves the page, pictures over HTTP and views that move, from a coordinator.",
      .examples = kExamples,
      .defaults = {.listen_address = absl::StrCat("127.0.0.1:", rpc::kGatewayPort)},
      .is_grpc_server = false,
      .dials = true,
      .add_flags = [&](cli::FlagSet* set) { AddFlags(set, &flags); },
      .check =
          [&](const rpc::ServerFlags& server_flags) { return CheckUsage(flags, server_flags); },
      .probe = [&](const rpc::ServerFlags& server_flags,
                   const std::string& address) { return Probe(flags, server_flags, address); },
      .start = [&](const rpc::ServerFlags& server_flags) { return Start(flags, server_flags); }};
  return rpc::RunServerProgram(program, argc, argv);
}

}  // namespace
}  // namespace isoscope::gateway

int main(int argc, char** argv) { return isoscope::gateway::Main(argc, argv); }
