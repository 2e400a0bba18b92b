// The main() of a server, step by step (ParseAndServe):
//
// 1. Set up the process, before any thread runs, and block the signals (ShutdownSignal).
// 2. Declare the flags. Answer --man-page and --completion, which need the declarations alone.
// 3. Parse. Wrong usage ends with 2; --help and --version print and end with 0.
// 4. With --probe, ask a running server and end with 0 or 1.
// 5. Check the flags against each other, start the server, and wait for SIGTERM or SIGINT.
// 6. Announce the drain, wait as long as the program asks, then shut down within the grace period.
//
// An exception on the way, such as std::bad_alloc, is one line on standard error and exit code 1.

#include "core/rpc/server_program.h"

#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"

#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/printable.h"
#include "core/base/process_setup.h"
#include "core/base/shutdown_signal.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/command_description.h"
#include "core/cli/flag_set.h"
#include "core/cli/man_page.h"
#include "core/cli/shell_completion.h"
#include "core/rpc/health_probe.h"
#include "core/rpc/transport.h"

namespace isoscope::rpc {
namespace {

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
// A server that takes longer counts as not serving.
constexpr absl::Duration kProbeTimeout = absl::Seconds(4);

// Silences gRPC's own log lines, unless GRPC_VERBOSITY asks for them. Statuses have the errors.
void SilenceGrpcLog() {
  constexpr int kKeepExisting = 0;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no other thread runs yet.
  setenv("GRPC_VERBOSITY", "NONE", kKeepExisting);
}

// REQUIRES: one of the names that --log-level takes.
base::LogLevel LogLevelFromName(absl::string_view name) {
  return name == "debug"     ? base::LogLevel::kDebug
         : name == "warning" ? base::LogLevel::kWarning
         : name == "error"   ? base::LogLevel::kError
         : name == "off"     ? base::LogLevel::kOff
                             : base::LogLevel::kInfo;
}

absl::Status CheckUsage(const ServerProgram& program, const ServerFlags& flags) {
  return program.check == nullptr ? CheckListen(flags.transport, flags.listen_address)
                                  : program.check(flags);
}

// Asks the server at `address`, or the one that these very flags would start.
absl::Status ProbeServer(const ServerFlags& flags, const std::string& address) {
  ISOSCOPE_ASSIGN_OR_RETURN(Dialing dialing, MakeDialing(flags.transport, /*own_role=*/""));
  if (flags.probe_address.empty() && flags.transport.has_tls()) {
    // That server shows our own certificate, which need not have the address of this machine.
    dialing.server_name = FirstNameOf(flags.transport.certificate_file);
  }
  return ProbeHealth(address, dialing, kProbeTimeout, flags.probe);
}

int RunProbe(const ServerProgram& program, const ServerFlags& flags) {
  const std::string address =
      flags.probe_address.empty() ? OwnAddress(flags.listen_address) : flags.probe_address;
  const absl::Status status =
      program.probe == nullptr ? ProbeServer(flags, address) : program.probe(flags, address);
  std::cout << address << ": "
            << (status.ok() ? flags.probe == Probe::kLive ? "live" : "serving"
                            : base::Printable(absl::StrCat("not serving: ", status.message())))
            << std::endl;
  return status.ok() ? kDone : kFailed;
}

// Waits for the shutdown signal. Meanwhile SIGUSR1 makes the log show debug lines, and SIGUSR2
// restores --log-level.
absl::string_view WaitForShutdown(const ServerFlags& flags, base::ShutdownSignal* shutdown_signal) {
  base::RestWatch watch;
  while (true) {
    const absl::string_view signal = shutdown_signal->Wait(base::RestWatch::kInterval);
    if (signal == "SIGUSR1" || signal == "SIGUSR2") {
      const std::string level = signal == "SIGUSR1" ? "debug" : flags.log_level;
      base::SetLogLevel(LogLevelFromName(level));
      base::LogInfo("log_level", {{"now", level}, {"signal", signal}});
    } else if (!signal.empty()) {
      return signal;
    } else if (watch.HasComeToRest(base::ProcessorTime())) {
      base::ReturnFreedMemory();
    }
  }
}

absl::Status Serve(const ServerProgram& program, const ServerFlags& flags,
                   base::ShutdownSignal* shutdown_signal) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ServerShutdown shut_down, program.start(flags));
  if (shut_down == nullptr) {
    return absl::OkStatus();
  }
  const absl::string_view signal_name = WaitForShutdown(flags, shutdown_signal);
  base::LogInfo("shutdown", {{"signal", signal_name}, {"drain_seconds", flags.drain_seconds}});
  if (program.announce_drain != nullptr && signal_name == "SIGTERM") {
    absl::SleepFor(program.announce_drain());
  }
  shut_down(absl::Seconds(flags.drain_seconds));
  base::LogInfo(absl::StrCat(program.log_name, "_stopped"));
  return absl::OkStatus();
}

constexpr char kEnvironmentNote[] =
    "Every option can also be given as the environment variable named beside it.\n"
    "SIGTERM and SIGINT end it after the frames in work; a second one ends it at once.\n"
    "SIGUSR1 shows debug lines in the log, SIGUSR2 goes back to --log-level.";

// Answers the flags that builds and shells use: --man-page, --completion SHELL. Unset if neither is
// given.
std::optional<int> DescribeItself(const ServerProgram& program, const cli::FlagSet& set, int argc,
                                  char** argv) {
  const absl::string_view asked = argc >= 2 ? argv[1] : "";
  const bool is_page = asked == "--man-page" && argc == 2;
  if (!is_page && (asked != "--completion" || argc != 3)) {
    return std::nullopt;
  }
  const cli::ProgramDescription description{
      .name = program.name,
      .summary = program.summary,
      .version = std::string(base::Version()),
      .commands = {{.name = "",
                    .summary = program.summary,
                    .usage = "[OPTIONS]",
                    .examples = absl::StrCat(program.examples, "\n", kEnvironmentNote),
                    .flags = set.Describe()}}};
  if (is_page) {
    std::cout << cli::CommandManPage(description, description.commands[0]);
    return kDone;
  }
  const absl::StatusOr<cli::Shell> shell = cli::ShellFromName(argv[2]);
  if (!shell.ok()) {
    std::cerr << program.name << ": --completion: " << shell.status().message() << "\n";
    return kWrongUsage;
  }
  std::cout << cli::CompletionScript(*shell, description);
  return kDone;
}

int ParseAndServe(const ServerProgram& program, int argc, char** argv) {
  base::SetUpProcess();
  SilenceGrpcLog();
  base::ShutdownSignal shutdown_signal;
  cli::FlagSet set({.name = program.name,
                    .summary = program.summary,
                    .notes = absl::StrCat("Examples:\n", program.examples, "\n", kEnvironmentNote),
                    .version = absl::StrCat(program.name, " ", base::Version())});
  ServerFlags flags = program.defaults;
  program.add_flags(&set);
  AddServerFlags(&set, &flags, program.is_grpc_server, program.dials);
  if (const std::optional<int> code = DescribeItself(program, set, argc, argv)) {
    return *code;
  }
  const absl::Status parsed = set.Parse(std::vector<std::string>(argv + 1, argv + argc));
  if (!parsed.ok()) {
    std::cerr << parsed.message() << "\nRun with --help for more information.\n";
    return kWrongUsage;
  }
  if (!set.requested_text().empty()) {
    std::cout << set.requested_text();
    return kDone;
  }
  base::SetLogLevel(LogLevelFromName(flags.log_level));
  base::SetLogFormat(flags.log_format == "json" ? base::LogFormat::kJson : base::LogFormat::kText);
  if (flags.is_probe) {
    return RunProbe(program, flags);
  }
  const absl::Status usage = CheckUsage(program, flags);
  if (!usage.ok()) {
    std::cerr << program.name << ": " << usage.message() << "\n";
    return kWrongUsage;
  }
  if (flags.transport.is_insecure) {
    base::LogWarning("insecure", {{"note", "plaintext: whoever reaches the network may read it"}});
  }
  const absl::Status status = Serve(program, flags, &shutdown_signal);
  if (!status.ok()) {
    std::cerr << program.name << ": " << base::Printable(status.message()) << "\n";
    return kFailed;
  }
  return kDone;
}

}  // namespace

int RunServerProgram(const ServerProgram& program, int argc, char** argv) {
  try {
    return ParseAndServe(program, argc, argv);
  } catch (const std::exception& error) {
    std::cerr << program.name << ": " << error.what() << "\n";
    return kFailed;
  }
}

}  // namespace isoscope::rpc
