// isoscope-gateway: the page and the HTTP interface in front of a coordinator.

#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <CLI/CLI.hpp>

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/rpc/channel.h"
#include "core/rpc/metrics_server.h"
#include "core/rpc/peer.h"
#include "core/rpc/server_program.h"
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
  std::string token;
  bool has_no_token = false;
  std::vector<std::string> allowed_origins;
  int max_connections = GatewayLimits().max_connections;
  int max_pictures = GatewayLimits().max_pictures;
  double max_picture_seconds = absl::ToDoubleSeconds(GatewayLimits().max_picture_duration);
};

constexpr char kExamples[] =
    R"(  isoscope-gateway --server 127.0.0.1:50051          the page on http://127.0.0.1:8080/
  isoscope-gateway --server coordinator:50051 --listen 0.0.0.0:8443 --user-tokens \
    --tls-cert gateway.pem --tls-key gateway.key --tls-ca ca.pem          https and wss
  isoscope-gateway --server coordinator:50051 --listen 0.0.0.0:8080 --insecure      asks for a token
  isoscope-gateway --allow-origin https://hub.example.org      pages of a notebook hub may ask, too
)";

void AddFlags(CLI::App* app, Flags* flags) {
  constexpr double kMaxSeconds = 86400;
  constexpr double kMinSeconds = 0.01;
  constexpr int kMaxConnections = 65536;
  app->add_option("--server", flags->server, "The coordinator, HOST:PORT or any gRPC target")
      ->type_name("TARGET")
      ->envname("ISOSCOPE_SERVER")
      ->capture_default_str();
  CLI::Option* const token =
      app->add_option("--token", flags->token,
                      "Ask for this token in every request for data; off the loopback address the "
                      "default is a random one, in the address that is logged")
          ->type_name("TEXT")
          ->envname("ISOSCOPE_TOKEN");
  app->add_flag("--no-token", flags->has_no_token,
                "Ask for none anywhere: where a proxy in front knows who asks")
      ->envname("ISOSCOPE_NO_TOKEN")
      ->excludes(token);
  CLI::Option* const user_tokens =
      app->add_flag(
             "--user-tokens", flags->has_user_tokens,
             "Each user shows a token that the coordinator knows (its --tokens); it is passed on")
          ->envname("ISOSCOPE_USER_TOKENS")
          ->excludes(token);
  app->add_option("--token-file", flags->token_file,
                  "A file with the token that the coordinator gets where the user shows none of "
                  "its own")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TOKEN_FILE")
      ->excludes(user_tokens);
  app->add_option("--https-cert", flags->https_certificate_file,
                  "The certificate for browsers, PEM, where it is not --tls-cert: one that they "
                  "know")
      ->type_name("FILE")
      ->envname("ISOSCOPE_HTTPS_CERT");
  app->add_option("--https-key", flags->https_key_file, "Its private key, PEM")
      ->type_name("FILE")
      ->envname("ISOSCOPE_HTTPS_KEY");
  app->add_flag(
         "--http", flags->serves_http,
         "Plain HTTP for browsers, even with --tls-cert: where a proxy in front has the TLS; "
         "beyond this machine with --insecure only")
      ->envname("ISOSCOPE_HTTP");
  app->add_option("--allow-origin", flags->allowed_origins,
                  "Pages of this origin may ask too, as https://HOST[:PORT]; repeatable")
      ->type_name("ORIGIN")
      ->delimiter(' ')
      ->envname("ISOSCOPE_ALLOW_ORIGIN");
  app->add_option("--max-connections", flags->max_connections, "Connections at a time")
      ->check(CLI::Range(1, kMaxConnections))
      ->envname("ISOSCOPE_MAX_CONNECTIONS")
      ->capture_default_str();
  app->add_option("--max-pictures", flags->max_pictures,
                  "Pictures and meshes in work at a time, viewers apart; more are refused")
      ->check(CLI::Range(1, kMaxConnections))
      ->envname("ISOSCOPE_MAX_PICTURES")
      ->capture_default_str();
  app->add_option("--max-picture-seconds", flags->max_picture_seconds,
                  "How long a picture or a mesh may take")
      ->check(CLI::Range(kMinSeconds, kMaxSeconds))
      ->envname("ISOSCOPE_MAX_PICTURE_SECONDS")
      ->capture_default_str();
}

// The certificate for browsers and its key; empty: plain HTTP.
std::pair<std::string, std::string> HttpsFiles(const Flags& flags,
                                               const rpc::ServerFlags& server_flags) {
  if (flags.serves_http) {
    return {};
  }
  return flags.https_certificate_file.empty()
             ? std::pair(server_flags.transport.certificate_file, server_flags.transport.key_file)
             : std::pair(flags.https_certificate_file, flags.https_key_file);
}

absl::Status CheckUsage(const Flags& flags, const rpc::ServerFlags& server_flags) {
  if (flags.https_certificate_file.empty() != flags.https_key_file.empty()) {
    return absl::InvalidArgumentError(
        "--https-cert and --https-key belong together: give both or neither");
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
  if (!flags.token_file.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.coordinator_token, rpc::ReadTokenFile(flags.token_file));
  }
  std::tie(options.certificate_file, options.key_file) = HttpsFiles(flags, server_flags);
  options.access.has_user_tokens = flags.has_user_tokens;
  options.coordinator_address = flags.server;
  options.listen_address = server_flags.listen_address;
  for (const std::string& origin : flags.allowed_origins) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.access.allowed_origins.emplace_back(), ParseOrigin(origin));
  }
  options.access.token = flags.token;
  if (flags.token.empty() && !flags.has_no_token && !flags.has_user_tokens &&
      !IsLoopback(options.listen_address)) {
    options.access.token = MakeToken();
  }
  options.limits.max_connections = flags.max_connections;
  options.limits.max_pictures = flags.max_pictures;
  options.limits.max_picture_duration = absl::Seconds(flags.max_picture_seconds);
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<GatewayServer> server, GatewayServer::Start(options));
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<rpc::MetricsServer> metrics,
                            rpc::MetricsServer::StartIfAsked(server_flags.metrics_listen, [server] {
                              return server->CollectMetrics();
                            }));
  base::LogInfo("gateway_started",
                {{"address", rpc::BoundAddress(server_flags.listen_address, server->port())},
                 // A token that the operator has given stays out of the log.
                 {"page", PageAddress(server_flags.listen_address, server->port(),
                                      flags.token.empty() ? options.access.token : "",
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
      .defaults = {.listen_address = "127.0.0.1:8080"},
      .is_grpc_server = false,
      .dials = true,
      .add_flags = [&](CLI::App* app) { AddFlags(app, &flags); },
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
