// Waits for SIGTERM or SIGINT without a signal handler.

#ifndef ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_
#define ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::base {

// Blocks SIGTERM and SIGINT in this thread and in all that it starts later, and ignores SIGPIPE. A
// process makes one, at the top of main, before any other thread.
class ShutdownSignal {
 public:
  ShutdownSignal();

  ShutdownSignal(const ShutdownSignal&) = delete;
  ShutdownSignal& operator=(const ShutdownSignal&) = delete;

  // Waits up to `patience` for one of the two, and returns its name, "SIGTERM" or "SIGINT"; "" if
  // none came. After one the default action holds again: a second signal ends the process at once.
  // REQUIRES: called by the thread that made this, and not again after a signal came.
  absl::string_view Wait(absl::Duration patience);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_SHUTDOWN_SIGNAL_H_
