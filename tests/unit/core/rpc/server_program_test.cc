#include "core/rpc/server_program.h"

#include <csignal>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "gtest/gtest.h"

namespace isoscope::rpc {
namespace {

using ::testing::ExitedWithCode;

// Ends this process with the exit code of a program that is called with `arguments`: run it inside
// of EXPECT_EXIT, which makes a process for it. Its standard output goes to standard error, too.
[[noreturn]] void RunAndExit(
    std::vector<std::string> arguments,
    std::function<absl::StatusOr<ServerShutdown>(const ServerFlags& flags)> start) {
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
                              .start = std::move(start)};
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
  EXPECT_EXIT(RunAndExit({"--listen", "localhost:1", "--drain-seconds", "2.5"}, start),
              ExitedWithCode(0),
              "listens on localhost:1\n(.*\n)*.*shutdown signal=SIGTERM drain_seconds=2.5\n"
              "drains for 2.5s\n.*test_stopped\n$");
}

}  // namespace
}  // namespace isoscope::rpc
