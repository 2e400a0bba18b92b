// isoscope-coordinator: the public service in front of the agents.
//
// AddFlags and CheckUsage read the command line, Start makes the server and its metrics.
// rpc::RunServerProgram calls these functions (rpc/server_program.h). An --agent is an address, a
// DNS name or a list in a file.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/flag_set.h"
#include "core/http/metrics_server.h"
#include "rpc/host_port.h"
#include "rpc/server_program.h"
#include "server/admission/coordinator_memory.h"
#include "server/cluster/agent_list.h"
#include "server/coordinator_server.h"

namespace isoscope::server {
namespace {

struct Flags {
  std::vector<std::string> agents;
  double max_frame_seconds = 300;
  double max_export_seconds = absl::ToDoubleSeconds(ExportLimits().max_duration);
  double poll_seconds = 2;
  std::string gateway_address;
  std::string token_file;
  std::string audit_log;
  std::int64_t memory_limit_bytes =
      static_cast<std::int64_t>(CoordinatorMemory::DefaultLimitBytes());
};

constexpr char kExamples[] =
    R"(  isoscope-coordinator --agent 127.0.0.1:50052 --agent 127.0.0.1:50053
  isoscope-coordinator --agent dns:///isoscope-agents:50052      every address behind the name
  isoscope-coordinator --agent file:/etc/isoscope/agents         those in the list, as it is now
  ISOSCOPE_AGENT="a:50052 b:50052" isoscope-coordinator --listen 0.0.0.0:50051 --tokens tokens.json \
    --tls-cert coordinator.pem --tls-key coordinator.key --tls-ca ca.pem
  isoscope-coordinator --probe                 whether the one on this machine serves
)";

// Returns an error for an address that no browser opens.
absl::Status CheckGatewayAddress(absl::string_view address) {
  const bool is_web_address =
      absl::StartsWith(address, "http://") || absl::StartsWith(address, "https://");
  return is_web_address ? absl::OkStatus()
                        : absl::InvalidArgumentError(absl::StrCat(
                              "'", address, "' is not http://HOST:PORT/ or https://..."));
}

void AddFlags(cli::FlagSet* set, Flags* flags) {
  constexpr double kMaxSeconds = 86400;
  constexpr double kMinSeconds = 0.01;
  set->AddTexts("--agent", "TARGET", &flags->agents,
                "An agent, HOST[:PORT] or any gRPC target; dns:///NAME[:PORT]: all behind the "
                "name; file:PATH: those in a list, one a line, which is read again; repeatable. "
                "The port is 50052 where none is named",
                /*splits_at_spaces=*/true)
      .Environment("ISOSCOPE_AGENT");
  set->AddNumber("--max-frame-seconds", &flags->max_frame_seconds, kMinSeconds, kMaxSeconds,
                 "How long a frame may take, whatever its client's deadline")
      .Environment("ISOSCOPE_MAX_FRAME_SECONDS");
  constexpr double kMaxExportSeconds = 7 * 86400;
  set->AddNumber("--max-export-seconds", &flags->max_export_seconds, kMinSeconds, kMaxExportSeconds,
                 "How long an export may take from its turn on, whatever its client's deadline")
      .Environment("ISOSCOPE_MAX_EXPORT_SECONDS");
  set->AddByteSize("--memory-limit", &flags->memory_limit_bytes,
                   static_cast<double>(CoordinatorMemory::kMinLimitBytes), 1e18,
                   "Memory for everything: pictures, planes, lists of blocks; e.g. 256MiB, 4GiB")
      .Environment("ISOSCOPE_MEMORY_LIMIT");
  set->AddNumber("--poll-seconds", &flags->poll_seconds, kMinSeconds, kMaxSeconds,
                 "How often agents are asked what they hold")
      .Environment("ISOSCOPE_POLL_SECONDS");
  set->Add(
         "--gateway-address", "URL",
         [flags](absl::string_view address) {
           flags->gateway_address = std::string(address);
           return CheckGatewayAddress(address);
         },
         "Where people find the web gateway, as in https://host:8080/; clients ask for it")
      .Environment("ISOSCOPE_GATEWAY_ADDRESS");
  set->AddText("--tokens", "FILE", &flags->token_file,
               "Clients' tokens and what they may see (docs/security.md), JSON; read again when "
               "it changes")
      .Environment("ISOSCOPE_TOKENS");
  set->AddText(
         "--audit-log", "FILE|-", &flags->audit_log,
         "Append a JSON line for each call, refused ones too: who, which dataset, what came of "
         "it; -: standard output")
      .Environment("ISOSCOPE_AUDIT_LOG");
}

absl::Status CheckUsage(const Flags& flags, const rpc::ServerFlags& server_flags) {
  ISOSCOPE_RETURN_IF_ERROR(rpc::CheckListen(server_flags.transport, server_flags.listen_address));
  if (flags.agents.empty()) {
    return absl::InvalidArgumentError("--agent is required: name at least one; see --help");
  }
  for (const std::string& target : flags.agents) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<std::string> list, ParseAgentListTarget(target));
    std::vector<std::string> dialled = {rpc::WithDefaultPort(target, rpc::kAgentPort)};
    if (list.has_value()) {
      ISOSCOPE_ASSIGN_OR_RETURN(dialled, ReadAgentList(*list));
    }
    for (const std::string& agent : dialled) {
      ISOSCOPE_RETURN_IF_ERROR(rpc::CheckDial(server_flags.transport, "the agent", agent));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<rpc::ServerShutdown> Start(const Flags& flags,
                                          const rpc::ServerFlags& server_flags) {
  CoordinatorServerOptions options;
  for (const std::string& target : flags.agents) {
    options.agents.push_back({rpc::WithDefaultPort(target, rpc::kAgentPort), nullptr});
  }
  options.listen_address = server_flags.listen_address;
  options.max_concurrent_frames = server_flags.max_concurrent_frames;
  options.max_queued_frames = server_flags.max_queued_frames;
  options.expected_viewport = view::kCommonViewport;
  options.max_frame_duration = absl::Seconds(flags.max_frame_seconds);
  options.export_limits.max_duration = absl::Seconds(flags.max_export_seconds);
  options.memory_limit_bytes = static_cast<std::size_t>(flags.memory_limit_bytes);
  options.poll_interval = absl::Seconds(flags.poll_seconds);
  options.gateway_address = flags.gateway_address;
  options.transport = server_flags.transport;
  options.token_file = flags.token_file;
  options.audit_log = flags.audit_log;
  options.has_reflection = server_flags.has_reflection;
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<CoordinatorServer> server,
                            CoordinatorServer::Start(options));
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::shared_ptr<http::MetricsServer> metrics,
      http::MetricsServer::StartIfAsked(server_flags.metrics_listen,
                                        [server] { return server->CollectMetrics(); }));
  base::LogInfo("coordinator_started",
                {{"address", rpc::BoundAddress(server_flags.listen_address, server->port())},
                 {"agents", base::OwnText{absl::StrJoin(flags.agents, ",")}},
                 {"version", base::Version()}});
  return [server = std::move(server), metrics = std::move(metrics)](absl::Duration grace) {
    server->Shutdown(grace);
  };
}

int Main(int argc, char** argv) {
  Flags flags;
  const rpc::ServerProgram program{
      .name = "isoscope-coordinator",
      .log_name = "coordinator",
      .summary = "Serves pictures and meshes of isosurfaces, made by partition agents.",
      .examples = kExamples,
      .defaults = {.listen_address = absl::StrCat("127.0.0.1:", rpc::kCoordinatorPort),
                   .max_queued_frames = 32},
      .dials = true,
      .add_flags = [&](cli::FlagSet* set) { AddFlags(set, &flags); },
      .check =
          [&](const rpc::ServerFlags& server_flags) { return CheckUsage(flags, server_flags); },
      .start = [&](const rpc::ServerFlags& server_flags) { return Start(flags, server_flags); }};
  return rpc::RunServerProgram(program, argc, argv);
}

}  // namespace
}  // namespace isoscope::server

int main(int argc, char** argv) { return isoscope::server::Main(argc, argv); }
