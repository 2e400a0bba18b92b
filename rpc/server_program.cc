// The main() of a server, step by step (ParseAndServe):
//
// 1. Set up the process, before any thread runs: logs of libraries, the limit of open files. Block
//    the signals (ShutdownSignal).
// 2. Declare the flags. Answer --man-page and --completion, which need the declarations alone.
// 3. Parse. Wrong usage ends with 2; --help and --version print and end with 0.
// 4. With --probe, ask a running server and end with 0 or 1.
// 5. Check the flags against each other, and start the server; a signal then ends the process. The
//    rest of the start, if there is one, goes on while the server answers. Wait for SIGTERM or
//    SIGINT.
// 6. Announce the drain, wait as long as the program asks, then shut down within the grace period.
//
// An exception on the way, such as std::bad_alloc, is one line on standard error and exit code 1.

#include "rpc/server_program.h"

#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"
#include "google/protobuf/stubs/logging.h"
#include <sys/resource.h>

#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/printable.h"
#include "core/base/process_setup.h"
#include "core/base/shutdown_signal.h"
#include "core/base/standstill.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/command_description.h"
#include "core/cli/flag_set.h"
#include "core/cli/man_page.h"
#include "core/cli/shell_completion.h"
#include "rpc/health_probe.h"
#include "rpc/transport.h"

namespace isoscope::rpc {
namespace {

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
constexpr int kSignalled = 128;  // and the signal's number, as shells have it
// A signal is noticed within this time.
constexpr absl::Duration kStep = absl::Milliseconds(100);
// After the drain, calls that are cut end within this time, unless they stand still.
constexpr absl::Duration kEndPatience = absl::Seconds(5);
// A server that takes longer counts as not serving.
constexpr absl::Duration kProbeTimeout = absl::Seconds(4);

// Silences gRPC's own log lines, unless GRPC_VERBOSITY asks for them. Statuses have the errors.
void SilenceGrpcLog() {
  constexpr int kKeepExisting = 0;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no other thread runs yet.
  setenv("GRPC_VERBOSITY", "NONE", kKeepExisting);
}

// Protobuf complains of messages that are none, which strangers may send.
void LogProtobuf(google::protobuf::LogLevel level, const char* /*file*/, int /*line*/,
                 const std::string& message) {
  base::Log(level == google::protobuf::LOGLEVEL_INFO    ? base::LogLevel::kDebug
            : level == google::protobuf::LOGLEVEL_FATAL ? base::LogLevel::kError
                                                        : base::LogLevel::kWarning,
            "protobuf", {{"note", message}});
}

// Each connection is an open file. Most systems begin with a limit of 1024, so that strangers who
// connect and say nothing could shut others out.
void RaiseFileLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur < limit.rlim_max) {
    limit.rlim_cur = limit.rlim_max;
    setrlimit(RLIMIT_NOFILE, &limit);
  }
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

// SIGUSR1 makes the log show debug lines, and SIGUSR2 restores --log-level. Returns other signals,
// and "".
absl::string_view HandleSignal(const ServerFlags& flags, absl::string_view signal) {
  if (signal != "SIGUSR1" && signal != "SIGUSR2") {
    return signal;
  }
  const std::string level = signal == "SIGUSR1" ? "debug" : flags.log_level;
  base::SetLogLevel(LogLevelFromName(level));
  base::LogInfo("log_level", {{"now", level}, {"signal", signal}});
  return "";
}

// Waits for the shutdown signal.
absl::string_view WaitForShutdown(const ServerFlags& flags, base::ShutdownSignal* shutdown_signal) {
  base::RestWatch watch;
  while (true) {
    const absl::string_view signal =
        HandleSignal(flags, shutdown_signal->Wait(base::RestWatch::kInterval));
    if (!signal.empty()) {
      return signal;
    }
    if (watch.HasComeToRest(base::ProcessorTime())) {
      base::ReturnFreedMemory();
    }
  }
}

// Ends the process at a signal while a server starts: nothing is to be drained or removed. Threads
// have the two signals blocked, and a file or a device may not answer.
class StartWatch {
 public:
  StartWatch() : thread_([this] { Run(); }) {}
  ~StartWatch() {
    has_started_.store(true);
    pthread_kill(thread_.native_handle(), kWake);
    thread_.join();
  }
  StartWatch(const StartWatch&) = delete;
  StartWatch& operator=(const StartWatch&) = delete;

 private:
  void Run() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, kWake);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGINT);
    const timespec interval = absl::ToTimespec(kStep);
    while (!has_started_.load()) {
      const int number = sigtimedwait(&signals, nullptr, &interval);
      if (number > 0 && number != kWake) {
        if (has_started_.load()) {
          kill(getpid(), number);  // for the server, which may have work by now
          return;
        }
        base::LogInfo("shutdown", {{"signal", number == SIGINT ? "SIGINT" : "SIGTERM"},
                                   {"note", "while it started"}});
        _exit(0);  // as after any shutdown: the port may answer already
      }
    }
  }

  static constexpr int kWake = SIGURG;  // nothing else here uses it

  std::atomic<bool> has_started_{false};
  std::thread thread_;
};

// Ends the process if its end stands still: a file, a disk or a device does not answer.
class EndWatch {
 public:
  // From `begin` on, which may lie ahead.
  EndWatch(absl::Duration begin, int signal_number)
      : thread_([this, begin, signal_number] { Run(begin, signal_number); }) {}
  ~EndWatch() {
    {
      const base::MutexLock lock(&mutex_);
      has_ended_ = true;
      changed_.SignalAll();
    }
    thread_.join();
  }
  EndWatch(const EndWatch&) = delete;
  EndWatch& operator=(const EndWatch&) = delete;

 private:
  // Returns true once the process has ended well.
  bool HasEndedWithin(absl::Duration duration) {
    const base::MutexLock lock(&mutex_);
    return changed_.AwaitUntil(&mutex_, base::MonotonicNow() + duration,
                               [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return has_ended_; });
  }

  void Run(absl::Duration begin, int signal_number) {
    if (HasEndedWithin(begin)) {
      return;
    }
    base::StandstillWatch watch(kStandstillSamples);
    while (!HasEndedWithin(kStep)) {
      if (watch.Sample()) {
        base::LogWarning("shutdown_forced",
                         {{"note", "a file, a disk or a device does not answer"}});
        _exit(kSignalled + signal_number);
      }
    }
  }

  static constexpr int kStandstillSamples = 5;

  base::Mutex mutex_;
  base::CondVar changed_;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

// The rest of the start, on a thread of its own (ServerProgram::finish_start).
class FinishingStart {
 public:
  explicit FinishingStart(const ServerProgram& program) {
    if (program.finish_start == nullptr) {
      is_done_.store(true);
      return;
    }
    thread_ = std::thread([this, &program] {
      status_ = program.finish_start(cancellation_);
      is_done_.store(true);
    });
  }
  ~FinishingStart() { End().IgnoreError(); }
  FinishingStart(const FinishingStart&) = delete;
  FinishingStart& operator=(const FinishingStart&) = delete;

  [[nodiscard]] bool is_done() const { return is_done_.load(); }
  // Cancels it if it is not done, and waits for its end.
  absl::Status End() {
    cancellation_.Cancel();
    if (thread_.joinable()) {
      thread_.join();
    }
    return status_;
  }

 private:
  base::Cancellation cancellation_;
  std::atomic<bool> is_done_{false};
  absl::Status status_;  // once the thread has ended
  std::thread thread_;
};

absl::Status Serve(const ServerProgram& program, const ServerFlags& flags,
                   base::ShutdownSignal* shutdown_signal) {
  ServerShutdown shut_down;
  {
    const StartWatch watch;
    ISOSCOPE_ASSIGN_OR_RETURN(shut_down, program.start(flags));
  }
  if (shut_down == nullptr) {
    return absl::OkStatus();
  }
  FinishingStart finishing(program);
  absl::string_view signal_name;
  while (!finishing.is_done() && signal_name != "SIGTERM" && signal_name != "SIGINT") {
    signal_name = HandleSignal(flags, shutdown_signal->Wait(kStep));
  }
  // A start that is done has frames in work, also if the signal came in the last step.
  if (!signal_name.empty() && !finishing.is_done()) {
    base::LogInfo("shutdown", {{"signal", signal_name}, {"note", "while it started"}});
    const EndWatch watch(absl::ZeroDuration(), signal_name == "SIGINT" ? SIGINT : SIGTERM);
    finishing.End().IgnoreError();
    shut_down(absl::ZeroDuration());
    base::LogInfo(absl::StrCat(program.log_name, "_stopped"));
    return absl::OkStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(finishing.End());
  if (signal_name.empty()) {
    signal_name = WaitForShutdown(flags, shutdown_signal);
  }
  base::LogInfo("shutdown", {{"signal", signal_name}, {"drain_seconds", flags.drain_seconds}});
  if (program.announce_drain != nullptr && signal_name == "SIGTERM") {
    absl::SleepFor(program.announce_drain());
  }
  const EndWatch watch(absl::Seconds(flags.drain_seconds) + kEndPatience,
                       signal_name == "SIGINT" ? SIGINT : SIGTERM);
  shut_down(absl::Seconds(flags.drain_seconds));
  shut_down = nullptr;  // the server ends under the watch
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
  google::protobuf::SetLogHandler(LogProtobuf);
  RaiseFileLimit();
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
