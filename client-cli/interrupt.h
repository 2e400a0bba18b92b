// SIGINT and SIGTERM as a Cancellation, so that an interrupted command cleans up.

#ifndef ISOSCOPE_CLIENT_CLI_INTERRUPT_H_
#define ISOSCOPE_CLIENT_CLI_INTERRUPT_H_

#include <functional>
#include <list>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"

#include "core/base/cancellation.h"

namespace isoscope::cli {

// Thread-safe.
class Interrupt {
 public:
  using Callback = std::function<void()>;

  // Calls a function when the interrupt comes, at once if it has come. Thread-compatible.
  class Scope {
   public:
    Scope(Interrupt* interrupt, Callback callback);
    // The function is not running any more, and will not.
    ~Scope();
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    Interrupt* const interrupt_;
    std::list<Callback>::iterator position_;
  };

  Interrupt() = default;
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  // Blocks the two signals in this thread and those it starts, and starts a thread that waits for
  // them: the first triggers, a second ends the process at once. Call first in main, at most once;
  // the interrupt must live as long as the process.
  void InstallForProcess();

  // What the first signal does.
  void Trigger();
  // Blocks until Trigger().
  void Wait();

  [[nodiscard]] const base::Cancellation& cancellation() const { return cancellation_; }

 private:
  base::Cancellation cancellation_;
  absl::Mutex mutex_;
  bool is_triggered_ ABSL_GUARDED_BY(mutex_) = false;
  std::list<Callback> callbacks_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_INTERRUPT_H_
