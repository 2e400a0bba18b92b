// Reads under way while what has arrived is worked on.

#ifndef ISOSCOPE_PARTITION_AGENT_QUEUED_READS_H_
#define ISOSCOPE_PARTITION_AGENT_QUEUED_READS_H_

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/io/read_queue.h"

namespace isoscope::agent {

// Calls `work` in the arena, on several threads at once, for each read of `queue` that arrives, and
// returns when all were worked on: the first error of `work` or `cancellation`, after which no
// further read is taken. Threads of the arena never wait for a disk; the calling one does.
absl::Status ForEachArrival(io::ReadQueue* queue, tbb::task_arena* arena,
                            const base::Cancellation& cancellation,
                            absl::FunctionRef<absl::Status(const io::ReadQueue::Arrival&)> work);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_QUEUED_READS_H_
