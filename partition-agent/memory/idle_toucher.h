// Touches memory for meshes while the agents of a process are idle, so that frames find it touched.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_IDLE_TOUCHER_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_IDLE_TOUCHER_H_

#include <cstddef>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::agent {

// Thread-safe.
class IdleToucher {
 public:
  struct Options {
    // Returns true if a frame is in work now.
    std::function<bool()> is_busy;
    // Touches a part of the missing memory, within a few milliseconds. Returns false if none is
    // missing.
    std::function<bool()> touch_some;
    // A process is idle if it had no work for this long.
    absl::Duration idle_after = absl::Milliseconds(50);
  };

  // Starts a thread of low priority.
  explicit IdleToucher(Options options);
  ~IdleToucher();
  IdleToucher(const IdleToucher&) = delete;
  IdleToucher& operator=(const IdleToucher&) = delete;

  // Notes the start of work.
  void NoteWork() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Run() ABSL_LOCKS_EXCLUDED(mutex_);

  const Options options_;
  base::Mutex mutex_;
  base::CondVar changed_;
  base::MonotonicTime last_work_ ABSL_GUARDED_BY(mutex_);
  bool has_worked_ ABSL_GUARDED_BY(mutex_) = false;  // since the thread last found nothing to do
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_IDLE_TOUCHER_H_
