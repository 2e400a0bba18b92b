// The interrupt of a frame, for code that no caller hands one: what opens a source reads addresses
// and asks other processes, and heeds ProcessInterrupt() alone.
//
//   {
//     const ThreadInterrupt interrupt(cancellation);
//     source = Open(request);  ends soon after the frame is cancelled
//   }

#ifndef ISOSCOPE_CORE_BASE_THREAD_INTERRUPT_H_
#define ISOSCOPE_CORE_BASE_THREAD_INTERRUPT_H_

#include "core/base/cancellation.h"

namespace isoscope::base {

// While it lives, ProcessInterrupt() of this thread also fires with `cancellation`, and has its
// deadline. Threads that this one starts do not inherit it. Made and destroyed on one thread, the
// last made first. `cancellation` outlives it, and whoever keeps ProcessInterrupt() does not.
class ThreadInterrupt {
 public:
  explicit ThreadInterrupt(const Cancellation& cancellation);
  ~ThreadInterrupt();
  ThreadInterrupt(const ThreadInterrupt&) = delete;
  ThreadInterrupt& operator=(const ThreadInterrupt&) = delete;

  // Of this thread; null: there is none.
  static const Cancellation* OfThread();

 private:
  const Cancellation* const outer_;  // of the thread; null: none
  Cancellation either_;
  const Cancellation::Callback by_caller_;
  const Cancellation::Callback by_outer_;
};

// The interrupt of the process, whatever thread asks: for who keeps it beyond a call.
const Cancellation& InterruptOfAllThreads();

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_THREAD_INTERRUPT_H_
