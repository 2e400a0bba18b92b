// The interrupt of a command, for code that no caller hands one: readers of formats, which
// libraries call, and what must be gone when the process ends at once.
//
// Ctrl-C or SIGTERM fires the interrupt (core/cli/interrupt.h). A command then cleans up and ends.
// If all of its threads stand still, because a file, a disk or a pipe does not answer, it can't.
// Then the process removes the unfinished paths and ends.

#ifndef ISOSCOPE_CORE_BASE_PROCESS_INTERRUPT_H_
#define ISOSCOPE_CORE_BASE_PROCESS_INTERRUPT_H_

#include <chrono>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"

namespace isoscope::base {

// The interrupt of this process; one that never fires where none is set. Thread-safe.
const Cancellation& ProcessInterrupt();
// CANCELLED once it has fired; for loops over files.
absl::Status CheckProcessInterrupt();
// Sets it, or takes it back with null. `interrupt` outlives its use.
void SetProcessInterrupt(const Cancellation* interrupt);

// A file or folder that is of no use if the process ends now. Thread-compatible.
class UnfinishedPath {
 public:
  explicit UnfinishedPath(std::string path);
  // The path is finished, or gone.
  ~UnfinishedPath();
  UnfinishedPath(const UnfinishedPath&) = delete;
  UnfinishedPath& operator=(const UnfinishedPath&) = delete;

 private:
  const std::string path_;
};

// Removes all unfinished paths that exist, with all in them. Returns once that is done, or after
// `patience`: a disk may not answer. For a process that ends right after it.
void RemoveUnfinishedPaths(absl::Duration patience);

// While one lives, an interrupted process may stand still, but not for longer than `at_most`: it
// waits for clients, or removes files. Thread-safe.
class OrderlyEnd {
 public:
  explicit OrderlyEnd(absl::Duration at_most);
  ~OrderlyEnd();
  OrderlyEnd(const OrderlyEnd&) = delete;
  OrderlyEnd& operator=(const OrderlyEnd&) = delete;

  // True while one lives whose time is not over.
  static bool IsUnderWay();

 private:
  const std::chrono::steady_clock::time_point end_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_PROCESS_INTERRUPT_H_
