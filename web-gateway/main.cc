// isoscope-gateway: the page and the HTTP interface in front of a coordinator.

#include <memory>
#include <string>
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
#include "core/rpc/server_program.h"
#include "web-gateway/gateway_server.h"

namespace isoscope::gateway {
namespace {

struct Flags {
  std::string server = "127.0.0.1:50051";
  std::string token;
  bool has_no_token = false;
  std::vector<std::string> allowed_origins;
  int max_connections = GatewayLimits().max_connections;
  int max_pictures = GatewayLimits().max_pictures;
  double max_picture_seconds = absl::ToDoubleSeconds(GatewayLimits().max_picture_duration);
};

constexpr char kExamples[] =
    R"(  isoscope-gateway --server 127.0.0.1:50051          the page on http://127.0.0.1:8080/
  isoscope-gateway --server coordinator:50051 --listen 0.0.0.0:8080      asks for a token
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

absl::StatusOr<rpc::ServerShutdown> Start(const Flags& flags,
                                          const rpc::ServerFlags& server_flags) {
  GatewayOptions options;
  options.channel = rpc::MakeChannel(flags.server);
  options.coordinator_address = flags.server;
  options.listen_address = server_flags.listen_address;
  for (const std::string& origin : flags.allowed_origins) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.access.allowed_origins.emplace_back(), ParseOrigin(origin));
  }
  options.access.token = flags.token;
  if (flags.token.empty() && !flags.has_no_token && !IsLoopback(options.listen_address)) {
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
                                      flags.token.empty() ? options.access.token : "")},
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
      .has_frame_flags = false,
      .add_flags = [&](CLI::App* app) { AddFlags(app, &flags); },
      .start = [&](const rpc::ServerFlags& server_flags) { return Start(flags, server_flags); }};
  return rpc::RunServerProgram(program, argc, argv);
}

}  // namespace
}  // namespace isoscope::gateway

int main(int argc, char** argv) { return isoscope::gateway::Main(argc, argv); }
