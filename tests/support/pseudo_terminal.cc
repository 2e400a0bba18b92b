#include "tests/support/pseudo_terminal.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>

#include "absl/strings/match.h"
#include <sys/ioctl.h>
#include <sys/wait.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"

namespace isoscope::testing {
namespace {

constexpr absl::Duration kPatience = absl::Seconds(120);

winsize ToWinsize(const PseudoTerminalSize& size) {
  winsize window{};
  window.ws_col = static_cast<unsigned short>(size.columns);       // NOLINT(google-runtime-int)
  window.ws_row = static_cast<unsigned short>(size.rows);          // NOLINT(google-runtime-int)
  window.ws_xpixel = static_cast<unsigned short>(size.width_px);   // NOLINT(google-runtime-int)
  window.ws_ypixel = static_cast<unsigned short>(size.height_px);  // NOLINT(google-runtime-int)
  return window;
}

std::vector<char*> Pointers(std::vector<std::string>* texts) {
  std::vector<char*> pointers;
  for (std::string& text : *texts) {
    pointers.push_back(text.data());
  }
  pointers.push_back(nullptr);
  return pointers;
}

}  // namespace

PseudoTerminal::PseudoTerminal(const PseudoTerminalSize& size) {
  winsize window = ToWinsize(size);
  ISOSCOPE_CHECK_EQ(openpty(&terminal_fd_, &program_fd_, nullptr, nullptr, &window), 0);
  for (const int fd : {terminal_fd_, program_fd_}) {
    fcntl(fd, F_SETFD, FD_CLOEXEC);
  }
}

PseudoTerminal::~PseudoTerminal() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  close(program_fd_);
  close(terminal_fd_);
}

void PseudoTerminal::Start(const std::vector<std::string>& argv,
                           const std::vector<std::string>& environment) {
  std::vector<std::string> arguments = argv;
  std::vector<std::string> variables = environment;
  const std::vector<char*> argument_pointers = Pointers(&arguments);
  const std::vector<char*> variable_pointers = Pointers(&variables);
  pid_ = fork();
  ISOSCOPE_CHECK_GE(pid_, 0);
  if (pid_ == 0) {
    setsid();
    ioctl(program_fd_, TIOCSCTTY, 0);
    for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
      dup2(program_fd_, fd);
    }
    execve(argument_pointers[0], argument_pointers.data(), variable_pointers.data());
    _exit(127);
  }
}

void PseudoTerminal::Press(absl::string_view keys) const {
  ISOSCOPE_CHECK_EQ(write(terminal_fd_, keys.data(), keys.size()),
                    static_cast<ssize_t>(keys.size()));
}

void PseudoTerminal::Resize(const PseudoTerminalSize& size) const {
  const winsize window = ToWinsize(size);
  ISOSCOPE_CHECK_EQ(ioctl(terminal_fd_, TIOCSWINSZ, &window), 0);
}

termios PseudoTerminal::settings() const {
  termios settings{};
  ISOSCOPE_CHECK_EQ(tcgetattr(program_fd_, &settings), 0);
  return settings;
}

bool PseudoTerminal::ReadSome(absl::Duration timeout) {
  pollfd waiting{.fd = terminal_fd_, .events = POLLIN, .revents = 0};
  if (poll(&waiting, 1, static_cast<int>(absl::ToInt64Milliseconds(timeout))) <= 0) {
    return false;
  }
  std::array<char, 65536> buffer{};
  const ssize_t size = read(terminal_fd_, buffer.data(), buffer.size());
  if (size <= 0) {
    return false;
  }
  bytes_.append(buffer.data(), static_cast<std::size_t>(size));
  return true;
}

bool PseudoTerminal::ReadUntil(const std::function<bool(const std::string& bytes)>& is_done) {
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  while (!is_done(bytes_)) {
    if (base::MonotonicNow() > deadline) {
      return false;
    }
    ReadSome(absl::Milliseconds(20));
  }
  return true;
}

bool PseudoTerminal::ReadUntilText(absl::string_view text) {
  return ReadUntil([text](const std::string& bytes) { return absl::StrContains(bytes, text); });
}

int PseudoTerminal::Wait() {
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  while (base::MonotonicNow() < deadline) {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      pid_ = -1;
      while (ReadSome(absl::ZeroDuration())) {
      }
      return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
    }
    ReadSome(absl::Milliseconds(20));
  }
  return -1;
}

}  // namespace isoscope::testing
