#include "client-cli/terminal/raw_terminal.h"

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/ioctl.h>
#include <sys/wait.h>

#include "client-cli/terminal/terminal.h"
#include "tests/support/pseudo_terminal.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using testing::PseudoTerminal;

bool HasEcho(const PseudoTerminal& terminal) {
  return (terminal.settings().c_lflag & (ECHO | ICANON)) == (ECHO | ICANON);
}

// Runs `body` in a process whose terminal this is, and returns how that ended.
template <typename Body>
int RunOn(const PseudoTerminal& terminal, Body body) {
  const pid_t pid = fork();
  if (pid == 0) {
    setsid();
    ioctl(terminal.program_fd(), TIOCSCTTY, 0);
    body(terminal.program_fd());
    _exit(0);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

TEST(RawTerminalTest, RefusesWhatIsNoTerminal) {
  const int fd = open("/dev/null", O_RDWR);
  EXPECT_THAT(RawTerminal::Enter(fd, "", "").status(),
              testing::StatusIs(absl::StatusCode::kFailedPrecondition));
  close(fd);
}

TEST(RawTerminalTest, TakesAndGivesBack) {
  PseudoTerminal terminal({});
  EXPECT_EQ(RunOn(terminal,
                  [](int fd) {
                    absl::StatusOr<std::unique_ptr<RawTerminal>> raw =
                        RawTerminal::Enter(fd, "<in>", "<out>");
                    termios settings{};
                    tcgetattr(fd, &settings);
                    const bool is_raw = (settings.c_lflag & (ECHO | ICANON)) == 0;
                    const bool has_signals = (settings.c_lflag & ISIG) != 0;
                    raw->reset();
                    _exit(is_raw && has_signals ? 7 : 1);
                  }),
            7);
  EXPECT_TRUE(HasEcho(terminal));
  EXPECT_TRUE(terminal.ReadUntilText("<in><out>"));
}

TEST(RawTerminalTest, AProgramThatAbortsGivesTheTerminalBackAndStillAborts) {
  for (const int number : {SIGABRT, SIGSEGV, SIGQUIT, SIGHUP}) {
    PseudoTerminal terminal({});
    EXPECT_EQ(RunOn(terminal,
                    [number](int fd) {
                      std::signal(number, SIG_DFL);  // sanitizers have handlers of their own
                      const auto raw = RawTerminal::Enter(fd, "", "<out>");
                      raise(number);
                    }),
              128 + number);
    EXPECT_TRUE(HasEcho(terminal)) << number;
    EXPECT_TRUE(terminal.ReadUntilText("<out>"));
  }
}

TEST(RawTerminalTest, RestoreTerminalWorksOnceAndFromAnywhere) {
  PseudoTerminal terminal({});
  EXPECT_EQ(RunOn(terminal,
                  [](int fd) {
                    const auto raw = RawTerminal::Enter(fd, "", "<out>");
                    RestoreTerminal();
                    RestoreTerminal();
                    _exit(3);
                  }),
            3);
  EXPECT_TRUE(HasEcho(terminal));
  EXPECT_TRUE(terminal.ReadUntilText("<out>"));
  EXPECT_EQ(terminal.bytes(), "<out>");
}

TEST(AskTerminalTest, ASilentTerminalCostsTheTimeOutAndGetsItsSettingsBack) {
  PseudoTerminal terminal({});
  EXPECT_EQ(RunOn(terminal,
                  [](int fd) {
                    _exit(AskTerminal(fd, absl::Milliseconds(50)) == TerminalAnswer() ? 5 : 1);
                  }),
            5);
  EXPECT_TRUE(HasEcho(terminal));
  EXPECT_TRUE(terminal.ReadUntilText("\x1B[c"));
}

TEST(AskTerminalTest, AnAnswerInPiecesIsReadToItsEnd) {
  PseudoTerminal terminal({});
  // Typed ahead: raw mode does not throw it away.
  terminal.Press("\x1B[6;20;10t\x1B[?62;");
  const pid_t presser = fork();
  if (presser == 0) {
    usleep(100'000);
    terminal.Press("4c");
    _exit(0);
  }
  EXPECT_EQ(RunOn(terminal,
                  [](int fd) {
                    const TerminalAnswer answer = AskTerminal(fd, absl::Seconds(60));
                    _exit(answer.has_sixel && answer.cell == view::Viewport{10, 20} ? 5 : 1);
                  }),
            5);
  waitpid(presser, nullptr, 0);
  EXPECT_TRUE(HasEcho(terminal));
}

}  // namespace
}  // namespace isoscope::cli
