// isoscope-agent: serves shards to a coordinator.
//
// 1. Start: arena, memory and renderer, then the port. From here on the agent answers.
// 2. FinishStart: opens the shards and prepares the renderer. OpeningLog logs the progress after a
//    second, and then every ten seconds.
// 3. AnnounceDrain, at SIGTERM: coordinators learn that the agent is about to stop, while it serves
//    on for --drain-notice-seconds.
//
// rpc::RunServerProgram calls these functions (rpc/server_program.h).

#include <cstddef>
#include <cstdint>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/version.h"
#include "core/cli/flag_set.h"
#include "core/formats/address_source.h"
#include "core/http/metrics_server.h"
#include "core/indexed/sample_opener.h"
#include "core/render/egl_context.h"
#include "core/render/renderer_factory.h"
#include "partition-agent/agent_server.h"
#include "rpc/host_port.h"
#include "rpc/server_program.h"

namespace isoscope::agent {
namespace {

struct Flags {
  std::vector<std::string> shards;
  std::vector<std::string> positional_shards;
  std::vector<std::string> allowed_sources;
  std::string renderer = "auto";
  int egl_device = -1;
  bool list_egl_devices = false;
  int threads = 0;
  double drain_notice_seconds = 3;
  std::int64_t memory_limit_bytes = static_cast<std::int64_t>(AgentMemory::DefaultLimitBytes());
};

constexpr char kExamples[] =
    R"(  isoscope-agent /data/head                       all shards of a dataset
  isoscope-agent --shard /data/head/shard-00000-of-00002 --listen 0.0.0.0:50052 \
    --tls-cert agent.pem --tls-key agent.key --tls-ca ca.pem
  ISOSCOPE_SHARD=/shard isoscope-agent --renderer cpu --threads 8      one directory
)";

void AddFlags(cli::FlagSet* set, Flags* flags) {
  set->AddTexts("directories", "DIR", &flags->positional_shards, "Shard or dataset directories");
  set->AddTexts("--shard", "DIR", &flags->shards,
                "A shard or dataset directory to serve; repeatable")
      .Environment("ISOSCOPE_SHARD");
  // One value each: directories may follow.
  set->AddRepeatable(
         "--allow-source", "PREFIX|RECORDED=ACTUAL",
         [flags](absl::string_view text) {
           flags->allowed_sources.emplace_back(text);
           return absl::OkStatus();
         },
         "A folder with sources of index-only datasets, which may be read; RECORDED=ACTUAL: "
         "what they recorded below RECORDED lies below ACTUAL here; repeatable")
      .Environment("ISOSCOPE_ALLOW_SOURCE");
  set->AddChoice("--renderer", &flags->renderer, {"auto", "egl", "cpu"},
                 "auto is egl on real hardware, else cpu")
      .Environment("ISOSCOPE_RENDERER");
  set->AddInteger("--egl-device", &flags->egl_device, -1, 1024,
                  "Which EGL device; -1: the first that works")
      .Environment("ISOSCOPE_EGL_DEVICE");
  set->AddSwitch("--list-egl-devices", &flags->list_egl_devices, "Print the EGL devices and exit");
  set->AddInteger("--threads", &flags->threads, 0, 4096,
                  "Threads that extract and draw; 0: all cores")
      .Environment("ISOSCOPE_THREADS");
  constexpr double kMaxNoticeSeconds = 3600;
  set->AddNumber("--drain-notice-seconds", &flags->drain_notice_seconds, 0.0, kMaxNoticeSeconds,
                 "How long it serves on after SIGTERM, so that coordinators learn in time that it "
                 "is about to stop; longer than their --poll-seconds")
      .Environment("ISOSCOPE_DRAIN_NOTICE_SECONDS");
  set->AddByteSize("--memory-limit", &flags->memory_limit_bytes,
                   static_cast<double>(AgentMemory::kMinLimitBytes), 1e18,
                   "Memory for everything: caches, frames, shard tables; e.g. 256MiB, 4GiB")
      .Environment("ISOSCOPE_MEMORY_LIMIT");
}

absl::Status CheckUsage(const Flags& flags, const rpc::ServerFlags& server_flags) {
  if (flags.list_egl_devices) {
    return absl::OkStatus();
  }
  if (flags.shards.empty() && flags.positional_shards.empty()) {
    return absl::InvalidArgumentError(
        "a shard or dataset directory (--shard DIR) is required; see --help");
  }
  return rpc::CheckListen(server_flags.transport, server_flags.listen_address);
}

absl::Status ListDevices() {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<render::EglDevice> devices, render::ListEglDevices());
  std::cout << render::FormatEglDevices(devices);
  return absl::OkStatus();
}

// The parts of a started agent.
struct Started {
  AgentServerOptions options;
  std::shared_ptr<AgentServer> server;
  std::string address;
};

// Logs how far the opening is, now and then, while it lives.
class OpeningLog {
 public:
  explicit OpeningLog(const Started& started) : thread_([this, &started] { Run(started); }) {}
  ~OpeningLog() {
    {
      const base::MutexLock lock(&mutex_);
      has_ended_ = true;
      changed_.SignalAll();
    }
    thread_.join();
  }
  OpeningLog(const OpeningLog&) = delete;
  OpeningLog& operator=(const OpeningLog&) = delete;

 private:
  void Run(const Started& started) {
    constexpr absl::Duration kFirst = absl::Seconds(1);  // most agents are open by then
    constexpr absl::Duration kInterval = absl::Seconds(10);
    absl::Duration wait = kFirst;
    const base::MutexLock lock(&mutex_);
    while (!changed_.AwaitUntil(&mutex_, base::MonotonicNow() + wait,
                                [this]()
                                    ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return has_ended_; })) {
      base::LogInfo("agent_opening", {{"address", started.address},
                                      {"progress", started.server->opening_summary()}});
      wait = kInterval;
    }
  }

  base::Mutex mutex_;
  base::CondVar changed_;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

// The agent answers, and opens its shards in FinishStart.
absl::StatusOr<rpc::ServerShutdown> Start(const Flags& flags, const rpc::ServerFlags& server_flags,
                                          Started* started) {
  if (flags.list_egl_devices) {
    ISOSCOPE_RETURN_IF_ERROR(ListDevices());
    return rpc::ServerShutdown();
  }
  AgentServerOptions options;
  options.directories = flags.positional_shards;
  options.directories.insert(options.directories.end(), flags.shards.begin(), flags.shards.end());
  options.listen_address = server_flags.listen_address;
  options.max_concurrent_frames = server_flags.max_concurrent_frames;
  options.max_queued_frames = server_flags.max_queued_frames;
  options.transport = server_flags.transport;
  options.has_reflection = server_flags.has_reflection;
  options.hides_paths = true;
  // A manifest may name an allowed server; that server may not name another one.
  source::RefuseOtherHosts();
  indexed::SourceAccess access;
  for (const std::string& text : flags.allowed_sources) {
    ISOSCOPE_ASSIGN_OR_RETURN(access.allowed.emplace_back(), indexed::ParseAllowedSource(text));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const render::RendererKind kind,
                            render::RendererKindFromName(flags.renderer));
  const auto limit_bytes = static_cast<std::size_t>(flags.memory_limit_bytes);
  options.arena = AgentMemory::MakeArena(flags.threads, limit_bytes);
  options.memory = std::make_shared<AgentMemory>(limit_bytes, AgentMemory::kDefaultStepCount,
                                                 options.arena->max_concurrency());
  access.max_bytes = options.memory->source_bytes();
  access.max_index_bytes = options.memory->source_index_bytes();
  options.open_samples = indexed::MakeSampleOpener(access);
  ISOSCOPE_ASSIGN_OR_RETURN(
      options.renderer,
      render::MakeRenderer({.kind = kind,
                            .egl_device = flags.egl_device,
                            .max_kept_mesh_bytes = options.memory->kept_mesh_bytes(),
                            .max_unused_bytes = options.memory->unused_image_bytes(),
                            .arena = options.arena}));
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<AgentServer> server, AgentServer::Listen(options));
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::shared_ptr<http::MetricsServer> metrics,
      http::MetricsServer::StartIfAsked(server_flags.metrics_listen,
                                        [server] { return server->CollectMetrics(); }));
  *started = {.options = options,
              .server = server,
              .address = rpc::BoundAddress(server_flags.listen_address, server->port())};
  return [server = std::move(server), metrics = std::move(metrics), started](absl::Duration grace) {
    server->Shutdown(grace);
    *started = {};  // the server ends with this function
  };
}

absl::Status FinishStart(const Started& started, const base::Cancellation& cancellation) {
  const AgentServerOptions& options = started.options;
  const auto settle = [&options]() -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(options.memory->Settle());
    options.renderer->Prepare(view::kCommonViewport, /*pass_count=*/1, /*image_count=*/1);
    return absl::OkStatus();
  };
  {
    const OpeningLog opening_log(started);
    ISOSCOPE_RETURN_IF_ERROR(started.server->Open(cancellation, settle));
  }
  base::LogInfo("agent_started", {{"address", started.address},
                                  {"shards", base::OwnText{started.server->shard_summary()}},
                                  {"renderer", options.renderer->description()},
                                  {"threads", options.arena->max_concurrency()},
                                  {"version", base::Version()}});
  return absl::OkStatus();
}

// Returns the time that coordinators may take to notice.
absl::Duration AnnounceDrain(const Flags& flags, const Started& started) {
  if (flags.drain_notice_seconds <= 0) {
    return absl::ZeroDuration();
  }
  started.server->AnnounceDrain();
  return absl::Seconds(flags.drain_notice_seconds);
}

int Main(int argc, char** argv) {
  Flags flags;
  Started started;
  const rpc::ServerProgram program{
      .name = "isoscope-agent",
      .log_name = "agent",
      .summary = "Serves the shards of isosurface datasets to a coordinator.",
      .examples = kExamples,
      .defaults = {.listen_address = absl::StrCat("127.0.0.1:", rpc::kAgentPort),
                   .max_queued_frames = 64},
      .add_flags = [&](cli::FlagSet* set) { AddFlags(set, &flags); },
      .check =
          [&](const rpc::ServerFlags& server_flags) { return CheckUsage(flags, server_flags); },
      .announce_drain = [&] { return AnnounceDrain(flags, started); },
      .start =
          [&](const rpc::ServerFlags& server_flags) {
            return Start(flags, server_flags, &started);
          },
      .finish_start =
          [&](const base::Cancellation& cancellation) {
            return started.server == nullptr ? absl::OkStatus()
                                             : FinishStart(started, cancellation);
          }};
  return rpc::RunServerProgram(program, argc, argv);
}

}  // namespace
}  // namespace isoscope::agent

int main(int argc, char** argv) { return isoscope::agent::Main(argc, argv); }
