// SIGINT and SIGTERM, or Trigger() alone, as a Cancellation: the interrupted work cleans up.

#ifndef ISOSCOPE_CORE_CLI_INTERRUPT_H_
#define ISOSCOPE_CORE_CLI_INTERRUPT_H_

#include <atomic>

#include "core/base/cancellation.h"

namespace isoscope::cli {

// Thread-safe.
class Interrupt {
 public:
  Interrupt() = default;
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  // Blocks the two signals in this thread and those it starts, and starts a thread that waits for
  // them: the first triggers, a second ends the process at once. So does the first if the process
  // then stands still (base::StandstillWatch) for half a second: a file, a disk or a pipe does not
  // answer, and nothing polls the cancellation. Before such an end that thread calls `before_exit`
  // (null: nothing to do) and removes the unfinished paths (base::UnfinishedPath).
  //
  // Makes it the interrupt of the process (base::ProcessInterrupt). Call this first in main, at
  // most once; the interrupt must live as long as the process.
  void InstallForProcess(void (*before_exit)() = nullptr);

  // Acts as the first signal does, even if nothing is installed. Never call it in a signal handler,
  // because it locks.
  void Trigger() { cancellation_.Cancel(); }
  // Blocks until Trigger().
  void Wait();

  [[nodiscard]] const base::Cancellation& cancellation() const { return cancellation_; }
  // The first signal that came, SIGINT for instance; 0 before one has.
  [[nodiscard]] int signal_number() const { return signal_number_.load(); }

 private:
  base::Cancellation cancellation_;
  std::atomic<int> signal_number_{0};
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_INTERRUPT_H_
