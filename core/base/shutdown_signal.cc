#include "core/base/shutdown_signal.h"

#include <csignal>

#include "core/base/check.h"

namespace isoscope::base {
namespace {

sigset_t ShutdownSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

sigset_t AllSignals() {
  sigset_t signals = ShutdownSignals();
  sigaddset(&signals, SIGUSR1);
  sigaddset(&signals, SIGUSR2);
  return signals;
}

}  // namespace

ShutdownSignal::ShutdownSignal() {
  const sigset_t signals = AllSignals();
  ISOSCOPE_CHECK_EQ(pthread_sigmask(SIG_BLOCK, &signals, nullptr), 0);
  // A log line into a closed pipe must not end the service.
  std::signal(SIGPIPE, SIG_IGN);
}

absl::string_view ShutdownSignal::Wait(absl::Duration patience) {
  const sigset_t signals = AllSignals();
  const timespec timeout = absl::ToTimespec(patience);
  const int number = sigtimedwait(&signals, nullptr, &timeout);
  if (number < 0) {
    return "";  // the time has passed, or another signal woke this thread
  }
  if (number == SIGUSR1 || number == SIGUSR2) {
    return number == SIGUSR1 ? "SIGUSR1" : "SIGUSR2";
  }
  std::signal(SIGTERM, SIG_DFL);
  std::signal(SIGINT, SIG_DFL);
  const sigset_t shutdown_signals = ShutdownSignals();
  ISOSCOPE_CHECK_EQ(pthread_sigmask(SIG_UNBLOCK, &shutdown_signals, nullptr), 0);
  return number == SIGINT ? "SIGINT" : "SIGTERM";
}

}  // namespace isoscope::base
