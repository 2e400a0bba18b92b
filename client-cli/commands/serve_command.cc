// isoscope serve INPUT | DIR [--listen HOST:PORT]

#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "client-cli/commands/program.h"
#include "client-cli/session/dataset_cache.h"
#include "client-cli/session/embedded_cluster.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/log.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/render/renderer_kind.h"
#include "rpc/host_port.h"
#include "rpc/server_flags.h"

namespace isoscope::cli {
namespace {

constexpr const char* kDefaultAddress = "127.0.0.1:50051";
// The time that frames in work may take after SIGTERM.
constexpr absl::Duration kGrace = absl::Seconds(30);

struct ServeFlags {
  SessionFlags session;  // only the flags of an input
  std::optional<std::string> listen_address;
  rpc::TransportFlags transport;
  std::string token_file;
  std::optional<render::RendererKind> renderer;
  std::optional<std::int64_t> thread_count;
  std::optional<std::int64_t> memory_limit_bytes;
};

absl::StatusOr<std::int64_t> ParseThreadCount(absl::string_view text) {
  return client::ParseInteger(text, 1, 1024);
}

absl::Status Run(const ServeFlags& flags, const Context& context) {
  if (!flags.session.input) {
    return UsageError("INPUT or DIR is missing: the volume or dataset folder to serve");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  EmbeddedClusterOptions options;
  options.listen_address = flags.listen_address.value_or(kDefaultAddress);
  const absl::Status secure = rpc::CheckListen(flags.transport, options.listen_address);
  if (!secure.ok()) {
    return UsageError(secure.message());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const CachedDataset dataset,
                            PrepareInput(flags.session, nullptr, context));
  options.dataset_directory = dataset.directory;
  options.transport = flags.transport;
  options.token_file = flags.token_file;
  options.renderer = flags.renderer.value_or(render::RendererKind::kAuto);
  options.thread_count = static_cast<int>(flags.thread_count.value_or(0));
  options.memory_limit_bytes = static_cast<std::size_t>(flags.memory_limit_bytes.value_or(0));
  options.expected_viewport = view::kCommonViewport;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<EmbeddedCluster> cluster,
                            EmbeddedCluster::Start(options));
  // The requested port may be 0.
  const std::string host = options.listen_address.substr(0, options.listen_address.rfind(':'));
  const std::string address = absl::StrCat(host, ":", cluster->port());
  if (!flags.transport.has_tls() && !rpc::IsLoopbackTarget(options.listen_address)) {
    base::LogWarning("insecure", {{"note", "plaintext: whoever reaches the network may read it"}});
  }
  base::LogInfo("serving", {{"address", address},
                            {"directory", base::OwnText{options.dataset_directory}},
                            {"shards", cluster->shard_count()},
                            {"renderer", cluster->renderer_description()}});
  *context.out << address << std::endl;
  context.interrupt->Wait();
  const base::OrderlyEnd drains(kGrace + absl::Seconds(5));
  base::LogInfo("draining", {{"grace_s", absl::ToInt64Seconds(kGrace)}});
  cluster->Shutdown(kGrace);
  base::LogInfo("stopped");
  return absl::OkStatus();
}

Action RegisterServeFlags(FlagSet* set) {
  const auto flags = std::make_shared<ServeFlags>();
  AddInputFlags(set, &flags->session);
  AddFlag(
      set, "--listen", "HOST[:PORT]", &flags->listen_address, rpc::ParseCoordinatorAddress,
      absl::StrCat("where to listen; port 0 takes a free one (default: ", kDefaultAddress, ")"));
  rpc::AddTransportFlags(set, &flags->transport, /*has_server_name=*/false);
  set->AddText("--tokens", "FILE", &flags->token_file,
               "clients' tokens and what they may see (docs/security.md), JSON");
  AddFlag(set, "--renderer", "auto|egl|cpu", &flags->renderer, render::RendererKindFromName,
          "back end (default: auto, EGL on a GPU, else the CPU)");
  AddFlag(set, "--threads", "T", &flags->thread_count, ParseThreadCount,
          "threads of all agents together (default: one for each core)");
  AddFlag(
      set, "--memory-limit", "BYTES", &flags->memory_limit_bytes, ParseAgentMemory,
      "memory of all agents together, as in 512MiB or 2G (default: a quarter of the machine's)");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command ServeCommand() {
  return {
      .name = "serve",
      .summary = "Serves a volume or a dataset folder: coordinator and all agents in this process",
      .usage = "INPUT | DIR [OPTIONS]",
      .examples =
          "  isoscope serve head.nii.gz\n"
          "  isoscope serve head\n"
          "  isoscope serve head --listen 0.0.0.0:50051 --tls-cert coordinator.pem \\\n"
          "    --tls-key coordinator.key --tls-ca ca.pem --tokens tokens.json\n"
          "\nPrints the address on standard output once frames can be rendered; log lines go\n"
          "to standard error. SIGTERM and SIGINT let frames in work finish, then it ends\n"
          "with 0.\n",
      .register_flags = RegisterServeFlags};
}

}  // namespace isoscope::cli
