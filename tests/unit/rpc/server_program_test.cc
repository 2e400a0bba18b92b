#include "rpc/server_program.h"

#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"

namespace isoscope::rpc {
namespace {

using ::testing::ExitedWithCode;

// Ends this process with the exit code of a program that is called with `arguments`: run it inside
// of EXPECT_EXIT, which makes a process for it. Its standard output goes to standard error, too.
[[noreturn]] void RunAndExit(
    std::vector<std::string> arguments,
    std::function<absl::StatusOr<ServerShutdown>(const ServerFlags& flags)> start,
    std::function<absl::Status(const base::Cancellation&)> finish_start = nullptr) {
  std::cout.rdbuf(std::cerr.rdbuf());
  arguments.insert(arguments.begin(), "isoscope-test");
  std::vector<char*> argv;
  for (std::string& argument : arguments) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  const ServerProgram program{.name = "isoscope-test",
                              .log_name = "test",
                              .summary = "Serves nothing.",
                              .examples = "  isoscope-test --listen h:1\n",
                              .defaults = {.listen_address = "127.0.0.1:7", .max_queued_frames = 9},
                              .add_flags =
                                  [](cli::FlagSet* set) {
                                    static bool own = false;
                                    set->AddSwitch("--own", &own, "");
                                  },
                              .start = std::move(start),
                              .finish_start = std::move(finish_start)};
  std::exit(RunServerProgram(program, static_cast<int>(arguments.size()), argv.data()));
}

absl::StatusOr<ServerShutdown> MustNotStart(const ServerFlags& /*flags*/) {
  throw std::logic_error("started");
}

TEST(ServerProgramTest, HelpHasTheFlagsOfBothKindsAndTheExamples) {
  for (const char* text : {"Serves nothing", "--own", "--listen .*127.0.0.1:7.*ISOSCOPE_LISTEN",
                           "--max-queued-frames .*9", "--drain-seconds", "--log-level",
                           "Examples:", "isoscope-test --listen h:1", "SIGTERM and SIGINT"}) {
    EXPECT_EXIT(RunAndExit({"--help"}, MustNotStart), ExitedWithCode(0), text);
  }
  EXPECT_EXIT(RunAndExit({"--version"}, MustNotStart), ExitedWithCode(0), "isoscope-test [0-9]");
}

TEST(ServerProgramTest, WrongUsageEndsWithTwo) {
  EXPECT_EXIT(RunAndExit({"--no-such-flag"}, MustNotStart), ExitedWithCode(2), "no-such-flag");
  EXPECT_EXIT(RunAndExit({"--max-concurrent-frames", "0"}, MustNotStart), ExitedWithCode(2),
              "max-concurrent-frames");
  EXPECT_EXIT(RunAndExit({"--log-level", "loud"}, MustNotStart), ExitedWithCode(2), "loud");
}

TEST(ServerProgramTest, PlaintextBeyondThisMachineIsRefusedUnlessItIsMeant) {
  EXPECT_EXIT(RunAndExit({"--listen", "0.0.0.0:7"}, MustNotStart), ExitedWithCode(2),
              "--listen 0.0.0.0:7 leaves this machine.*--insecure");
  EXPECT_EXIT(RunAndExit({"--listen", "0.0.0.0:7", "--insecure"},
                         [](const ServerFlags& /*flags*/) { return ServerShutdown(); }),
              ExitedWithCode(0), "warning insecure");
}

TEST(ServerProgramTest, AStartThatFailsEndsWithOneAndOneLine) {
  EXPECT_EXIT(RunAndExit({},
                         [](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
                           return absl::UnavailableError("the port is taken");
                         }),
              ExitedWithCode(1), "^isoscope-test: the port is taken\n$");
  EXPECT_EXIT(RunAndExit({}, MustNotStart), ExitedWithCode(1), "^isoscope-test: started\n$");
}

TEST(ServerProgramTest, NothingToServeIsDoneAtOnce) {
  EXPECT_EXIT(RunAndExit({}, [](const ServerFlags& /*flags*/) { return ServerShutdown(); }),
              ExitedWithCode(0), "^$");
}

TEST(ServerProgramTest, TheFirstSignalDrainsTheServer) {
  const auto start = [](const ServerFlags& flags) -> absl::StatusOr<ServerShutdown> {
    std::cerr << "listens on " << flags.listen_address << "\n";
    std::raise(SIGTERM);  // waits until the program asks for it
    return [](absl::Duration grace) { std::cerr << "drains for " << grace << "\n"; };
  };
  EXPECT_EXIT(RunAndExit({"--listen", "localhost"}, start), ExitedWithCode(0),
              "listens on localhost:7\n");
  EXPECT_EXIT(RunAndExit({"--listen", "localhost:1", "--drain-seconds", "2.5"}, start),
              ExitedWithCode(0),
              "listens on localhost:1\n(.*\n)*.*shutdown signal=SIGTERM drain_seconds=2.5\n"
              "drains for 2.5s\n.*test_stopped\n$");
}

TEST(ServerProgramTest, ASignalWhileItStartsIsAShutdown) {
  for (const int number : {SIGTERM, SIGINT}) {
    const auto start = [number](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
      kill(getpid(), number);  // for whichever thread waits for it
      absl::SleepFor(absl::Minutes(5));
      return absl::InternalError("it went on");
    };
    EXPECT_EXIT(RunAndExit({}, start), ExitedWithCode(0), "shutdown signal=.*while it started");
  }
}

// Symptom: "while it started" with frames in work, if the signal came within 100 ms of the end of the
// start.
TEST(ServerProgramTest, ASignalJustAfterTheStartDrainsTheServer) {
  struct AtEndOfThread {
    ~AtEndOfThread() { kill(getpid(), SIGTERM); }
  };
  const auto start = [](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
    return [](absl::Duration grace) { std::cerr << "drains for " << grace << "\n"; };
  };
  const auto finish = [](const base::Cancellation& /*cancellation*/) {
    // The thread of the start ends once the start is done.
    [[maybe_unused]] thread_local const AtEndOfThread at_end;
    return absl::OkStatus();
  };
  EXPECT_EXIT(RunAndExit({"--drain-seconds", "2.5"}, start, finish), ExitedWithCode(0),
              "^(.*\n)*drains for 2.5s\n.*test_stopped\n$");
}

TEST(ServerProgramTest, TheLogLevelChangesWhileItRuns) {
  const auto start = [](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
    std::raise(SIGUSR1);
    std::raise(SIGTERM);  // the lower number comes first, whatever was raised first
    return [](absl::Duration /*grace*/) { base::LogDebug("seen_at_debug"); };
  };
  EXPECT_EXIT(RunAndExit({"--log-level", "warning"}, start), ExitedWithCode(0),
              "log_level now=debug signal=SIGUSR1\n(.*\n)*.*debug seen_at_debug");
  const auto start_and_back = [](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
    std::raise(SIGUSR2);
    std::raise(SIGTERM);
    return [](absl::Duration /*grace*/) { base::LogDebug("seen_at_debug"); };
  };
  EXPECT_EXIT(RunAndExit({}, start_and_back), ExitedWithCode(0),
              "log_level now=info signal=SIGUSR2\n.*shutdown[^\n]*\n.*test_stopped\n$");
}

TEST(ServerProgramTest, LogLinesAreJsonOnRequest) {
  const auto start = [](const ServerFlags& /*flags*/) -> absl::StatusOr<ServerShutdown> {
    std::raise(SIGTERM);
    return [](absl::Duration /*grace*/) {};
  };
  EXPECT_EXIT(RunAndExit({"--log-format", "json"}, start), ExitedWithCode(0),
              "^\\{\"time\":\"[0-9T:.-]+Z\",\"level\":\"info\",\"event\":\"shutdown\","
              "\"signal\":\"SIGTERM\",\"drain_seconds\":\"30\"\\}\n");
}

TEST(ServerProgramTest, AProbeNamesWhatItAsksAndWhom) {
  const auto parse = [](absl::string_view text) {
    ServerFlags flags;
    const absl::Status status = ParseProbe(text, &flags);
    return status.ok()
               ? std::string(flags.probe == Probe::kLive ? "live " : "ready ") + flags.probe_address
               : std::string("wrong");
  };
  EXPECT_EQ(parse(""), "ready ");
  EXPECT_EQ(parse("ready"), "ready ");
  EXPECT_EQ(parse("live"), "live ");
  EXPECT_EQ(parse("h:1"), "ready h:1");
  EXPECT_EQ(parse("live,h:1"), "live h:1");
  EXPECT_EQ(parse("ready,[::1]:7"), "ready [::1]:7");
  EXPECT_EQ(parse("live,"), "wrong");
  EXPECT_EQ(parse("lively"), "wrong");
  EXPECT_EQ(parse("live,ready"), "wrong");
}

}  // namespace
}  // namespace isoscope::rpc
