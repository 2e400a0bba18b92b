#include "partition-agent/memory/frames_in_work.h"

#include "core/base/monotonic_time.h"

namespace isoscope::agent {

// The callbacks of interrupted work lock other mutexes than this one, and are short.
void FramesInWork::Begin() {
  const base::MutexLock lock(&mutex_);
  ++frame_count_;
  for (base::Cancellation* const work : interrupted_) {
    work->Cancel();
  }
}

void FramesInWork::End() {
  const base::MutexLock lock(&mutex_);
  if (--frame_count_ == 0) {
    idle_since_ = base::MonotonicNow();
    changed_.SignalAll();
  }
}

void FramesInWork::CountDiskWaits(int change) {
  const base::MutexLock lock(&mutex_);
  disk_wait_count_ += change;
  if (disk_wait_count_ == 0) {
    changed_.SignalAll();
  }
}

FramesInWork::Interruption::Interruption(FramesInWork* frames, base::Cancellation* work)
    : frames_(*frames), work_(work) {
  const base::MutexLock lock(&frames_.mutex_);
  frames_.interrupted_.push_back(work);
  if (frames_.frame_count_ > 0) {
    work->Cancel();
  }
}

FramesInWork::Interruption::~Interruption() {
  const base::MutexLock lock(&frames_.mutex_);
  std::erase(frames_.interrupted_, work_);
}

absl::Status FramesInWork::AwaitIdle(const base::Cancellation& cancellation,
                                     absl::Duration duration) {
  const base::Cancellation::Callback wake(cancellation, [this] {
    const base::MutexLock lock(&mutex_);
    changed_.SignalAll();
  });
  const base::MutexLock lock(&mutex_);
  while (!cancellation.is_cancelled()) {
    const base::MonotonicTime end =
        frame_count_ > 0 ? base::MonotonicTime::InfiniteFuture() : idle_since_ + duration;
    if (end <= base::MonotonicNow()) {
      return absl::OkStatus();
    }
    changed_.WaitUntil(&mutex_, end);
  }
  return cancellation.Check();
}

absl::Status FramesInWork::AwaitIdleDisk(const base::Cancellation& cancellation) {
  return base::AwaitOrCancelled(
      cancellation, &mutex_, &changed_,
      [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return disk_wait_count_ == 0; });
}

}  // namespace isoscope::agent
