#include "core/base/thread_interrupt.h"

#include <algorithm>

#include "core/base/process_interrupt.h"

namespace isoscope::base {
namespace {

const Cancellation*& InterruptOfThread() {
  static thread_local const Cancellation* interrupt = nullptr;
  return interrupt;
}

}  // namespace

ThreadInterrupt::ThreadInterrupt(const Cancellation& cancellation)
    : outer_(InterruptOfThread()),
      either_(std::min(cancellation.deadline(), ProcessInterrupt().deadline())),
      by_caller_(cancellation, [this] { either_.Cancel(); }),
      by_outer_(ProcessInterrupt(), [this] { either_.Cancel(); }) {
  InterruptOfThread() = &either_;
}

ThreadInterrupt::~ThreadInterrupt() { InterruptOfThread() = outer_; }

const Cancellation* ThreadInterrupt::OfThread() { return InterruptOfThread(); }

}  // namespace isoscope::base
