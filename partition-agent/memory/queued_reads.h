// Processes reads that have arrived while others are under way.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_QUEUED_READS_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_QUEUED_READS_H_

#include <functional>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/metrics.h"
#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "core/io/read_queue.h"
#include "partition-agent/memory/frames_in_work.h"

namespace isoscope::agent {

// Receivers of the times. Each may be null.
struct ReadWatch {
  // Copies from the system's memory ("read"), waits for the disk ("wait for reads") and calls of
  // `work` ("extract").
  base::TraceRecorder* trace = nullptr;
  base::Counter* wait = nullptr;   // a duration: waits for the disk
  FramesInWork* frames = nullptr;  // the same waits, while they last
};

// Conditions under which all threads interrupt their work; by default never.
struct Pauses {
  // Returns true if a pause is due. Then threads begin no work, and return kPaused from their
  // present work as soon as they can. Thread-safe.
  std::function<bool()> is_due = [] { return false; };
  // Called while no work runs, on the calling thread, outside of the arena. Afterwards no pause is
  // due.
  std::function<absl::Status()> pause = [] { return absl::OkStatus(); };
};
enum class ArrivalWork {
  kDone,
  kPaused,  // called again with this arrival after the pause
};

// Calls `work` for each read of `queue` that arrives, on several threads of the arena at once.
// Returns when all are done, or the first error of `work`, `pauses` or `cancellation`; after an
// error it takes no further read. Threads of the arena never wait for a disk. The calling thread
// does, and holds no lock.
absl::Status ForEachArrival(
    io::ReadQueue* queue, base::TaskArena* arena, const base::Cancellation& cancellation,
    absl::FunctionRef<absl::StatusOr<ArrivalWork>(const io::ReadQueue::Arrival&)> work,
    const Pauses& pauses = {}, const ReadWatch& watch = {});

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_QUEUED_READS_H_
