#include "core/cli/interrupt.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): sigwait is POSIX, not <csignal>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/standstill.h"
#include "core/cli/end_note.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

// A process that stands still is ended after this many samples at this interval.
constexpr int kStandstillSamples = 5;
constexpr absl::Duration kSampleInterval = absl::Milliseconds(100);
// A process that works on is told how to end it after this many.
constexpr int kHintSamples = 20;
// The end does not wait longer for a disk.
constexpr absl::Duration kRemovalPatience = absl::Milliseconds(500);

// Writes a line to standard error, unless nobody takes it.
void SayLine(const std::string& line) {
  pollfd entry{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  if (poll(&entry, 1, 0) == 1 && (entry.revents & POLLOUT) != 0) {
    const std::string text =
        absl::StrCat(program_invocation_short_name, ": ", line, "\n");  // NOLINT: glibc's
    static_cast<void>(!write(STDERR_FILENO, text.data(), text.size()));
  }
}

// Says why the process ends at once, and how to go on.
void SayEnd(absl::string_view why, int signal) {
  const std::string note = EndNote::OfProcess();
  if (!why.empty() || !note.empty()) {
    SayLine(
        absl::StrCat("ended by SIG", sigabbrev_np(signal), why, note.empty() ? "" : "; ", note));
  }
}

// Waits for a second signal, or until the process stands still; says so then.
void AwaitEnd(const sigset_t& signals, int first_signal) {
  base::StandstillWatch watch(kStandstillSamples);
  const timespec interval = absl::ToTimespec(kSampleInterval);
  for (int sample = 1;; ++sample) {
    if (const int second = sigtimedwait(&signals, nullptr, &interval); second > 0) {
      SayEnd("", second);
      return;
    }
    if (base::OrderlyEnd::IsUnderWay()) {
      watch = base::StandstillWatch(kStandstillSamples);
    } else if (watch.Sample()) {
      SayEnd(" while it waited for a file, a disk or a pipe that does not answer", first_signal);
      return;
    }
    if (sample == kHintSamples && isatty(STDERR_FILENO) == 1) {
      SayLine("ends after the work at hand; Ctrl-C once more ends it at once");
    }
  }
}

}  // namespace

void Interrupt::InstallForProcess(void (*before_exit)()) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  base::SetProcessInterrupt(&cancellation_);
  std::thread([this, signals, before_exit] {
    int signal_number = 0;
    sigwait(&signals, &signal_number);
    signal_number_.store(signal_number);
    Trigger();
    AwaitEnd(signals, signal_number);
    if (before_exit != nullptr) {
      before_exit();
    }
    base::RemoveUnfinishedPaths(kRemovalPatience);
    _exit(kExitInterrupted + signal_number);
  }).detach();
}

void Interrupt::Wait() {
  base::Mutex mutex;
  base::CondVar never;
  base::AwaitOrCancelled(cancellation_, &mutex, &never, [] { return false; }).IgnoreError();
}

}  // namespace isoscope::cli
