// Tells work that is done ahead of frames when the frames of a process need the threads, the memory
// or the disk.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_FRAMES_IN_WORK_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_FRAMES_IN_WORK_H_

#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::agent {

// Thread-safe. Outlives the objects below.
class FramesInWork {
 public:
  // A frame in work, of any agent of the process.
  class Frame {
   public:
    explicit Frame(FramesInWork* frames) : frames_(*frames) { frames_.Begin(); }
    ~Frame() { frames_.End(); }
    Frame(const Frame&) = delete;
    Frame& operator=(const Frame&) = delete;

   private:
    FramesInWork& frames_;
  };
  // A frame that waits for the disk. Does nothing for null.
  class DiskWait {
   public:
    explicit DiskWait(FramesInWork* frames) : frames_(frames) { Count(1); }
    ~DiskWait() { Count(-1); }
    DiskWait(const DiskWait&) = delete;
    DiskWait& operator=(const DiskWait&) = delete;

   private:
    void Count(int change) {
      if (frames_ != nullptr) {
        frames_->CountDiskWaits(change);
      }
    }
    FramesInWork* const frames_;
  };
  // Cancels work as soon as a frame begins; at once if one is in work.
  class Interruption {
   public:
    Interruption(FramesInWork* frames, base::Cancellation* work);
    ~Interruption();
    Interruption(const Interruption&) = delete;
    Interruption& operator=(const Interruption&) = delete;

   private:
    FramesInWork& frames_;
    base::Cancellation* const work_;
  };

  // Waits until no frame has been in work for `duration`; the error of `cancellation` if it fires
  // first.
  absl::Status AwaitIdle(const base::Cancellation& cancellation, absl::Duration duration)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Waits until no frame waits for the disk; the error of `cancellation` if it fires first.
  absl::Status AwaitIdleDisk(const base::Cancellation& cancellation) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Begin() ABSL_LOCKS_EXCLUDED(mutex_);
  void End() ABSL_LOCKS_EXCLUDED(mutex_);
  void CountDiskWaits(int change) ABSL_LOCKS_EXCLUDED(mutex_);

  base::Mutex mutex_;
  base::CondVar changed_;
  int frame_count_ ABSL_GUARDED_BY(mutex_) = 0;
  int disk_wait_count_ ABSL_GUARDED_BY(mutex_) = 0;
  base::MonotonicTime idle_since_ ABSL_GUARDED_BY(mutex_) = base::MonotonicTime::InfinitePast();
  std::vector<base::Cancellation*> interrupted_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_FRAMES_IN_WORK_H_
