#include "client-cli/interrupt.h"

#include <pthread.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): sigwait is POSIX, not <csignal>
#include <unistd.h>

#include <thread>
#include <utility>

#include "client-cli/usage.h"

namespace isoscope::cli {

Interrupt::Scope::Scope(Interrupt* interrupt, Callback callback) : interrupt_(interrupt) {
  absl::MutexLock lock(&interrupt_->mutex_);
  if (interrupt_->is_triggered_) {
    callback();
  }
  position_ = interrupt_->callbacks_.insert(interrupt_->callbacks_.end(), std::move(callback));
}

Interrupt::Scope::~Scope() {
  absl::MutexLock lock(&interrupt_->mutex_);
  interrupt_->callbacks_.erase(position_);
}

void Interrupt::InstallForProcess() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([this, signals] {
    int signal_number = 0;
    sigwait(&signals, &signal_number);
    Trigger();
    sigwait(&signals, &signal_number);
    _exit(kExitFailed);
  }).detach();
}

void Interrupt::Trigger() {
  cancellation_.Cancel();
  absl::MutexLock lock(&mutex_);
  is_triggered_ = true;
  for (const Callback& callback : callbacks_) {
    callback();
  }
}

void Interrupt::Wait() {
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&is_triggered_));
}

}  // namespace isoscope::cli
