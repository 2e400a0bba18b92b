#include "core/cli/interrupt.h"

#include <pthread.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): sigwait is POSIX, not <csignal>
#include <unistd.h>

#include <thread>

#include "core/base/mutex.h"
#include "core/cli/usage.h"

namespace isoscope::cli {

void Interrupt::InstallForProcess(void (*before_exit)()) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([this, signals, before_exit] {
    int signal_number = 0;
    sigwait(&signals, &signal_number);
    signal_number_.store(signal_number);
    Trigger();
    sigwait(&signals, &signal_number);
    if (before_exit != nullptr) {
      before_exit();
    }
    _exit(kExitInterrupted + signal_number);
  }).detach();
}

void Interrupt::Wait() {
  base::Mutex mutex;
  base::CondVar never;
  base::AwaitOrCancelled(cancellation_, &mutex, &never, [] { return false; }).IgnoreError();
}

}  // namespace isoscope::cli
