#include "partition-agent/memory/idle_toucher.h"

#include <algorithm>
#include <utility>

#include "core/base/monotonic_time.h"
#include "partition-agent/memory/low_priority.h"

namespace isoscope::agent {

IdleToucher::IdleToucher(Options options)
    : options_(std::move(options)), thread_([this] { Run(); }) {}

IdleToucher::~IdleToucher() {
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    changed_.SignalAll();
  }
  thread_.join();
}

void IdleToucher::NoteWork() {
  const base::MutexLock lock(&mutex_);
  last_work_ = base::MonotonicNow();
  if (!std::exchange(has_worked_, true)) {
    changed_.SignalAll();
  }
}

void IdleToucher::Run() {
  LowerPriorityOfThisThread();
  while (true) {
    {
      const base::MutexLock lock(&mutex_);
      changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return has_worked_ || is_stopping_;
      });
      // New work delays it.
      while (!is_stopping_ && base::MonotonicNow() < last_work_ + options_.idle_after) {
        changed_.AwaitUntil(&mutex_, last_work_ + options_.idle_after,
                            [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return is_stopping_; });
      }
      if (is_stopping_) {
        return;
      }
      has_worked_ = false;
    }
    if (options_.is_busy()) {
      NoteWork();
    } else if (options_.touch_some()) {
      const base::MutexLock lock(&mutex_);
      has_worked_ = true;  // more memory may need touching
    }
  }
}

}  // namespace isoscope::agent
