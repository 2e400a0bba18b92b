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

}  // namespace

ShutdownSignal::ShutdownSignal() {
  const sigset_t signals = ShutdownSignals();
  ISOSCOPE_CHECK_EQ(pthread_sigmask(SIG_BLOCK, &signals, nullptr), 0);
  // A log line into a closed pipe must not end the service.
  std::signal(SIGPIPE, SIG_IGN);
}

absl::string_view ShutdownSignal::Wait(absl::Duration patience) {
  const sigset_t signals = ShutdownSignals();
  const timespec timeout = absl::ToTimespec(patience);
  const int number = sigtimedwait(&signals, nullptr, &timeout);
  if (number < 0) {
    return "";  // the time has passed, or another signal woke this thread
  }
  std::signal(SIGTERM, SIG_DFL);
  std::signal(SIGINT, SIG_DFL);
  ISOSCOPE_CHECK_EQ(pthread_sigmask(SIG_UNBLOCK, &signals, nullptr), 0);
  return number == SIGINT ? "SIGINT" : "SIGTERM";
}

}  // namespace isoscope::base
