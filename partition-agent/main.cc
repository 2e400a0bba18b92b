// isoscope-agent: serves shards to a coordinator.

#include <cstdint>
#include <exception>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include <CLI/CLI.hpp>
#include <oneapi/tbb/info.h>

#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/shutdown_signal.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/version.h"
#include "core/render/egl_context.h"
#include "core/render/renderer_factory.h"
#include "core/rpc/server_flags.h"
#include "partition-agent/agent_server.h"

namespace isoscope::agent {
namespace {

constexpr int kUsageError = 2;
constexpr int kStartError = 1;

struct Flags {
  std::vector<std::string> shards;
  std::vector<std::string> positional_shards;
  std::string listen = "0.0.0.0:50052";
  std::string renderer = "auto";
  int egl_device = -1;
  bool list_egl_devices = false;
  int threads = 0;
  std::size_t memory_limit_bytes = AgentMemory::DefaultLimitBytes();
  int max_concurrent_frames = 4;
  int max_queued_frames = 64;
  double drain_seconds = 30;
  std::string log_level = "info";
};

constexpr char kFooter[] = R"(Examples:
  isoscope-agent /data/head                       all shards of a dataset
  isoscope-agent --shard /data/head/shard-00000-of-00002 --listen 0.0.0.0:50052
  ISOSCOPE_SHARD=/shard isoscope-agent --renderer cpu --threads 8

Every option can also be given as the environment variable named beside it (ISOSCOPE_SHARD: one
directory).
SIGTERM and SIGINT end it after the frames in work; a second one ends it at once.)";

void AddFlags(CLI::App* app, Flags* flags) {
  app->add_option("directories", flags->positional_shards, "Shard or dataset directories")
      ->type_name("DIR");
  app->add_option("--shard", flags->shards, "A shard or dataset directory to serve; repeatable")
      ->type_name("DIR")
      ->envname("ISOSCOPE_SHARD");
  app->add_option("--listen", flags->listen, "Address to serve on; port 0 takes a free one")
      ->type_name("HOST:PORT")
      ->envname("ISOSCOPE_LISTEN")
      ->capture_default_str();
  app->add_option("--renderer", flags->renderer, "auto is egl on real hardware, else cpu")
      ->check(CLI::IsMember({"auto", "egl", "cpu"}))
      ->envname("ISOSCOPE_RENDERER")
      ->capture_default_str();
  app->add_option("--egl-device", flags->egl_device, "Which EGL device; -1: the first that works")
      ->check(CLI::Range(-1, 1024))
      ->envname("ISOSCOPE_EGL_DEVICE")
      ->capture_default_str();
  app->add_flag("--list-egl-devices", flags->list_egl_devices, "Print the EGL devices and exit");
  app->add_option("--threads", flags->threads, "Threads that extract and draw; 0: all cores")
      ->check(CLI::Range(0, 4096))
      ->envname("ISOSCOPE_THREADS")
      ->capture_default_str();
  app->add_option("--memory-limit", flags->memory_limit_bytes,
                  "Memory for everything: caches, frames, shard tables; e.g. 256MiB, 4GiB")
      ->type_name("BYTES")
      ->transform(CLI::AsSizeValue(false))
      ->check(CLI::Range(static_cast<double>(AgentMemory::kMinLimitBytes), 1e18))
      ->envname("ISOSCOPE_MEMORY_LIMIT")
      ->capture_default_str();
  app->add_option("--max-concurrent-frames", flags->max_concurrent_frames,
                  "Frames that may be in work at a time")
      ->check(CLI::Range(1, 1024))
      ->envname("ISOSCOPE_MAX_CONCURRENT_FRAMES")
      ->capture_default_str();
  app->add_option("--max-queued-frames", flags->max_queued_frames,
                  "Frames that may wait; more are refused")
      ->check(CLI::Range(0, 1 << 20))
      ->envname("ISOSCOPE_MAX_QUEUED_FRAMES")
      ->capture_default_str();
  rpc::AddServerFlags(app, &flags->drain_seconds, &flags->log_level);
  app->footer(kFooter);
}

absl::Status ListDevices() {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<render::EglDevice> devices, render::ListEglDevices());
  std::cout << render::FormatEglDevices(devices);
  return absl::OkStatus();
}

absl::Status Serve(const Flags& flags, base::ShutdownSignal* shutdown_signal) {
  AgentServerOptions options;
  options.directories = flags.positional_shards;
  options.directories.insert(options.directories.end(), flags.shards.begin(), flags.shards.end());
  options.listen_address = flags.listen;
  options.max_concurrent_frames = flags.max_concurrent_frames;
  options.max_queued_frames = flags.max_queued_frames;
  ISOSCOPE_ASSIGN_OR_RETURN(const render::RendererKind kind,
                            render::RendererKindFromName(flags.renderer));
  options.arena = base::MakeTaskArena(flags.threads);
  options.memory = std::make_shared<AgentMemory>(flags.memory_limit_bytes);
  ISOSCOPE_ASSIGN_OR_RETURN(
      options.renderer,
      render::MakeRenderer({.kind = kind,
                            .egl_device = flags.egl_device,
                            .max_kept_mesh_bytes = options.memory->kept_mesh_bytes(),
                            .max_unused_bytes = options.memory->unused_image_bytes()}));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<AgentServer> server, AgentServer::Start(options));
  ISOSCOPE_RETURN_IF_ERROR(options.memory->Settle());
  options.renderer->Prepare(view::kCommonViewport, /*pass_count=*/1);
  base::LogInfo("agent_started", {{"address", rpc::BoundAddress(flags.listen, server->port())},
                                  {"shards", server->shard_summary()},
                                  {"renderer", options.renderer->description()},
                                  {"threads", options.arena->max_concurrency()},
                                  {"version", base::Version()}});
  const absl::string_view signal_name = shutdown_signal->Wait();
  base::LogInfo("shutdown", {{"signal", signal_name}, {"drain_seconds", flags.drain_seconds}});
  server->Shutdown(absl::Seconds(flags.drain_seconds));
  base::LogInfo("agent_stopped");
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  // Debian builds abseil with it: every lock would take a global one.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  base::LimitMallocArenas(oneapi::tbb::info::default_concurrency());
  rpc::SilenceGrpcLog();
  base::ShutdownSignal shutdown_signal;
  Flags flags;
  CLI::App app("Serves the shards of isosurface datasets to a coordinator.", "isoscope-agent");
  app.set_version_flag("--version", absl::StrCat("isoscope-agent ", base::Version()));
  AddFlags(&app, &flags);
  try {
    app.parse(argc, argv);
    if (!flags.list_egl_devices && flags.shards.empty() && flags.positional_shards.empty()) {
      throw CLI::RequiredError("a shard or dataset directory (--shard DIR)");
    }
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }
  rpc::ApplyLogLevel(flags.log_level);
  const absl::Status status =
      flags.list_egl_devices ? ListDevices() : Serve(flags, &shutdown_signal);
  if (!status.ok()) {
    std::cerr << "isoscope-agent: " << status.message() << "\n";
    return kStartError;
  }
  return 0;
}

}  // namespace
}  // namespace isoscope::agent

int main(int argc, char** argv) {
  try {
    return isoscope::agent::Main(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "isoscope-agent: " << error.what() << "\n";
    return 1;
  }
}
