// The saved settings lie in plain memory of this file, written before `is_taken` is set. So signal
// handlers and the end of the process read them without locks.
//
//   event                   action
//   destructor, exit        restores the settings and writes the bytes of `leave`
//   fatal signal            does the same, then the signal's previous action
//   Ctrl-Z (Suspend)        restores, stops the process, and takes the terminal again afterwards
//   TerminalSignals         handlers only set flags and write to an eventfd, which wakes the loop

#include "client-cli/terminal/raw_terminal.h"

#include <poll.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): sigaction is POSIX, not <csignal>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>

#include "absl/strings/str_cat.h"
#include <sys/eventfd.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

constexpr std::size_t kMaxLeaveBytes = 256;
// Signals that may end the process at any point.
constexpr std::array<int, 7> kFatalSignals = {SIGABRT, SIGBUS,  SIGFPE, SIGHUP,
                                              SIGILL,  SIGQUIT, SIGSEGV};

struct TakenTerminal {
  int fd = -1;
  termios before{};
  std::array<char, kMaxLeaveBytes> leave{};
  std::size_t leave_size = 0;
  std::array<struct sigaction, kFatalSignals.size()> handlers{};
};

// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables): for signal handlers
TakenTerminal taken;
// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables): for signal handlers
std::atomic<bool> is_taken{false};

// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables): for signal handlers
std::atomic<bool> is_resized{false};
// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables): for signal handlers
std::atomic<bool> is_suspended{false};
// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables): for signal handlers
std::atomic<int> wake_event{-1};

static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

// Restores the terminal, then runs the signal's previous action.
void OnFatalSignal(int number) {
  RestoreTerminal();
  for (std::size_t i = 0; i < kFatalSignals.size(); ++i) {
    if (kFatalSignals[i] == number) {
      sigaction(number, &taken.handlers[i], nullptr);
    }
  }
  raise(number);
}

void OnTerminalSignal(int number) {
  const int error = errno;
  (number == SIGTSTP ? is_suspended : is_resized).store(true);
  TerminalSignals::Wake();
  errno = error;
}

absl::Status TerminalError(const char* what) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): glibc's strerror is thread-safe
  return absl::UnavailableError(absl::StrCat(what, ": ", strerror(errno)));
}

// The kernel stops a background process that changes the terminal's settings.
bool OwnsTerminal(int fd) { return tcgetpgrp(fd) == getpgrp(); }

}  // namespace

void RestoreTerminal() {
  if (!is_taken.exchange(false)) {
    return;
  }
  const int error = errno;
  std::size_t done = 0;
  while (done < taken.leave_size) {
    const ssize_t written = write(taken.fd, taken.leave.data() + done, taken.leave_size - done);
    if (written < 0 && errno != EINTR) {
      break;
    }
    done += static_cast<std::size_t>(std::max<ssize_t>(written, 0));
  }
  tcsetattr(taken.fd, TCSANOW, &taken.before);
  errno = error;
}

RawTerminal::RawTerminal(int fd, absl::string_view enter, absl::string_view leave)
    : fd_(fd), enter_(enter), leave_(leave) {
  ISOSCOPE_CHECK_LE(leave.size(), kMaxLeaveBytes);
}

absl::StatusOr<std::unique_ptr<RawTerminal>> RawTerminal::Enter(int fd, absl::string_view enter,
                                                                absl::string_view leave) {
  ISOSCOPE_CHECK(!is_taken.load());
  auto terminal = std::unique_ptr<RawTerminal>(new RawTerminal(fd, enter, leave));
  ISOSCOPE_RETURN_IF_ERROR(terminal->Take());
  return terminal;
}

absl::Status RawTerminal::Take() {
  termios settings{};
  if (isatty(fd_) != 1 || tcgetattr(fd_, &settings) != 0) {
    return absl::FailedPreconditionError("there is no terminal");
  }
  if (!OwnsTerminal(fd_)) {
    return absl::FailedPreconditionError(
        "the terminal belongs to another program: this one runs "
        "in the background");
  }
  taken.fd = fd_;
  taken.before = settings;
  taken.leave_size = leave_.size();
  std::copy(leave_.begin(), leave_.end(), taken.leave.begin());
  struct sigaction action {};
  action.sa_handler = OnFatalSignal;
  sigemptyset(&action.sa_mask);
  for (std::size_t i = 0; i < kFatalSignals.size(); ++i) {
    sigaction(kFatalSignals[i], &action, &taken.handlers[i]);
  }
  is_taken.store(true);
  settings.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  if (tcsetattr(fd_, TCSANOW, &settings) != 0) {
    return TerminalError("the terminal's settings could not be changed");
  }
  return WriteToTerminal(fd_, enter_);
}

RawTerminal::~RawTerminal() {
  RestoreTerminal();
  for (std::size_t i = 0; i < kFatalSignals.size(); ++i) {
    sigaction(kFatalSignals[i], &taken.handlers[i], nullptr);
  }
}

absl::Status RawTerminal::Suspend() {
  RestoreTerminal();
  for (std::size_t i = 0; i < kFatalSignals.size(); ++i) {
    sigaction(kFatalSignals[i], &taken.handlers[i], nullptr);
  }
  struct sigaction by_default {};
  struct sigaction before {};
  by_default.sa_handler = SIG_DFL;
  sigaction(SIGTSTP, &by_default, &before);
  // To this thread: so the process has stopped before the next line runs.
  raise(SIGTSTP);
  sigaction(SIGTSTP, &before, nullptr);
  // A shell may continue the process in the background. Then it waits until it is in the
  // foreground, but not for ever: the shell may be gone.
  constexpr int kMaxWaits = 100;
  for (int i = 0; i < kMaxWaits && !OwnsTerminal(fd_); ++i) {
    raise(SIGTTIN);
  }
  return Take();
}

absl::Status WriteToTerminal(int fd, absl::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(fd, bytes.data(), bytes.size());
    if (written >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno == EAGAIN) {
      pollfd waiting{.fd = fd, .events = POLLOUT, .revents = 0};
      poll(&waiting, 1, -1);
    } else if (errno != EINTR) {
      return TerminalError("the terminal takes no bytes");
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> ReadFromTerminal(int fd, absl::Duration timeout) {
  const base::MonotonicTime deadline = base::MonotonicNow() + timeout;
  while (true) {
    const std::int64_t left_ms =
        std::max<std::int64_t>(0, absl::ToInt64Milliseconds(deadline - base::MonotonicNow()));
    pollfd waiting{.fd = fd, .events = POLLIN, .revents = 0};
    const int ready =
        poll(&waiting, 1, static_cast<int>(std::min<std::int64_t>(left_ms, 1'000'000)));
    if (ready == 0) {
      return std::string();
    }
    if (ready > 0) {
      std::array<char, 512> buffer{};
      const ssize_t size = read(fd, buffer.data(), buffer.size());
      if (size > 0) {
        return std::string(buffer.data(), static_cast<std::size_t>(size));
      }
      if (size == 0 || (errno != EINTR && errno != EAGAIN)) {
        return absl::UnavailableError("the terminal is gone");
      }
    } else if (errno != EINTR) {
      return TerminalError("the terminal gives no bytes");
    }
  }
}

namespace {

struct SignalHandlers {
  struct sigaction suspend {};
  struct sigaction resize {};
};
SignalHandlers& HandlersBefore() {
  static SignalHandlers handlers;
  return handlers;
}

}  // namespace

TerminalSignals::TerminalSignals() {
  const int event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  ISOSCOPE_CHECK_GE(event, 0);
  wake_event.store(event);
  is_resized.store(false);
  is_suspended.store(false);
  struct sigaction action {};
  action.sa_handler = OnTerminalSignal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(SIGTSTP, &action, &HandlersBefore().suspend);
  sigaction(SIGWINCH, &action, &HandlersBefore().resize);
}

TerminalSignals::~TerminalSignals() {
  sigaction(SIGTSTP, &HandlersBefore().suspend, nullptr);
  sigaction(SIGWINCH, &HandlersBefore().resize, nullptr);
  close(wake_event.exchange(-1));
}

TerminalSignals::Pending TerminalSignals::Take() {
  std::uint64_t count = 0;
  if (read(wake_fd(), &count, sizeof(count)) < 0) {
    // No byte was pending.
  }
  return {.is_resized = is_resized.exchange(false), .is_suspended = is_suspended.exchange(false)};
}

int TerminalSignals::wake_fd() { return wake_event.load(); }

void TerminalSignals::Wake() {
  const std::uint64_t one = 1;
  const int event = wake_event.load();
  if (event >= 0 && write(event, &one, sizeof(one)) < 0) {
    // The counter is full, so the descriptor is readable already.
  }
}

}  // namespace isoscope::cli
