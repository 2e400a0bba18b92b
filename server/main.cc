// isoscope-coordinator: the public service in front of the agents.

#include <exception>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include <CLI/CLI.hpp>

#include "core/base/log.h"
#include "core/base/shutdown_signal.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/rpc/server_flags.h"
#include "server/coordinator_server.h"

namespace isoscope::server {
namespace {

constexpr int kUsageError = 2;
constexpr int kStartError = 1;

struct Flags {
  std::vector<std::string> agents;
  std::string listen = "0.0.0.0:50051";
  int max_concurrent_frames = 4;
  int max_queued_frames = 32;
  double max_frame_seconds = 300;
  double poll_seconds = 2;
  double drain_seconds = 30;
  std::string log_level = "info";
};

constexpr char kFooter[] = R"(Examples:
  isoscope-coordinator --agent 10.0.0.7:50052 --agent 10.0.0.8:50052
  isoscope-coordinator --agent dns:///isoscope-agents:50052      every address behind the name
  ISOSCOPE_AGENT="a:50052 b:50052" isoscope-coordinator --listen 0.0.0.0:50051

Every option can also be given as the environment variable named beside it.
SIGTERM and SIGINT end it after the frames in work; a second one ends it at once.)";

void AddFlags(CLI::App* app, Flags* flags) {
  constexpr double kMaxSeconds = 86400;
  constexpr double kMinSeconds = 0.01;
  app->add_option("--agent", flags->agents,
                  "An agent, HOST:PORT or any gRPC target; dns:///NAME:PORT: all behind the name; "
                  "repeatable")
      ->type_name("TARGET")
      ->delimiter(' ')  // several in the environment variable
      ->envname("ISOSCOPE_AGENT")
      ->required();
  app->add_option("--listen", flags->listen, "Address to serve on; port 0 takes a free one")
      ->type_name("HOST:PORT")
      ->envname("ISOSCOPE_LISTEN")
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
  app->add_option("--max-frame-seconds", flags->max_frame_seconds,
                  "How long a frame may take, whatever its client's deadline")
      ->check(CLI::Range(kMinSeconds, kMaxSeconds))
      ->envname("ISOSCOPE_MAX_FRAME_SECONDS")
      ->capture_default_str();
  app->add_option("--poll-seconds", flags->poll_seconds,
                  "How often agents are asked what they hold")
      ->check(CLI::Range(kMinSeconds, kMaxSeconds))
      ->envname("ISOSCOPE_POLL_SECONDS")
      ->capture_default_str();
  rpc::AddServerFlags(app, &flags->drain_seconds, &flags->log_level);
  app->footer(kFooter);
}

absl::Status Serve(const Flags& flags, base::ShutdownSignal* shutdown_signal) {
  CoordinatorServerOptions options;
  for (const std::string& target : flags.agents) {
    options.agents.push_back({target, nullptr});
  }
  options.listen_address = flags.listen;
  options.max_concurrent_frames = flags.max_concurrent_frames;
  options.max_queued_frames = flags.max_queued_frames;
  options.expected_viewport = view::kCommonViewport;
  options.max_frame_duration = absl::Seconds(flags.max_frame_seconds);
  options.poll_interval = absl::Seconds(flags.poll_seconds);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<CoordinatorServer> server,
                            CoordinatorServer::Start(options));
  base::LogInfo("coordinator_started",
                {{"address", rpc::BoundAddress(flags.listen, server->port())},
                 {"agents", absl::StrJoin(flags.agents, ",")},
                 {"version", base::Version()}});
  const absl::string_view signal_name = shutdown_signal->Wait();
  base::LogInfo("shutdown", {{"signal", signal_name}, {"drain_seconds", flags.drain_seconds}});
  server->Shutdown(absl::Seconds(flags.drain_seconds));
  base::LogInfo("coordinator_stopped");
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  // Debian builds abseil with it: every lock would take a global one.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  rpc::SilenceGrpcLog();
  base::ShutdownSignal shutdown_signal;
  Flags flags;
  CLI::App app("Serves pictures and meshes of isosurfaces, made by partition agents.",
               "isoscope-coordinator");
  app.set_version_flag("--version", absl::StrCat("isoscope-coordinator ", base::Version()));
  AddFlags(&app, &flags);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }
  rpc::ApplyLogLevel(flags.log_level);
  const absl::Status status = Serve(flags, &shutdown_signal);
  if (!status.ok()) {
    std::cerr << "isoscope-coordinator: " << status.message() << "\n";
    return kStartError;
  }
  return 0;
}

}  // namespace
}  // namespace isoscope::server

int main(int argc, char** argv) {
  try {
    return isoscope::server::Main(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "isoscope-coordinator: " << error.what() << "\n";
    return 1;
  }
}
