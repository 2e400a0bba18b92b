// Waits for SIGTERM or SIGINT, and for SIGUSR1 and SIGUSR2, without a signal handler.

#ifndef ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_
#define ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::base {

// Blocks the four signals in this thread and in all that it starts later, and ignores SIGPIPE. A
// process makes one, at the top of main, before any other thread.
class ShutdownSignal {
 public:
  ShutdownSignal();

  ShutdownSignal(const ShutdownSignal&) = delete;
  ShutdownSignal& operator=(const ShutdownSignal&) = delete;

  // Waits up to `patience` for one of the four, and returns its name, such as "SIGTERM"; "" if none
  // came. After SIGTERM or SIGINT their default action holds again: a second one ends the process
  // at once. REQUIRES: called by the thread that made this, and not again after one of these two.
  absl::string_view Wait(absl::Duration patience);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_
