#include "partition-agent/queued_reads.h"

#include <atomic>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/status_macros.h"

namespace isoscope::agent {

absl::Status ForEachArrival(io::ReadQueue* queue, tbb::task_arena* arena,
                            const base::Cancellation& cancellation,
                            absl::FunctionRef<absl::Status(const io::ReadQueue::Arrival&)> work) {
  std::atomic<bool> has_error{false};
  absl::Mutex mutex;
  absl::Status first_error;
  const auto work_off = [&](int /*thread*/) {
    while (!has_error.load(std::memory_order_relaxed)) {
      const std::optional<io::ReadQueue::Arrival> arrival = queue->TryTake();
      if (!arrival.has_value()) {
        return;
      }
      absl::Status status = cancellation.Check();
      if (status.ok()) {
        status = work(*arrival);
      }
      if (!status.ok()) {
        absl::MutexLock lock(&mutex);
        first_error.Update(status);
        has_error.store(true, std::memory_order_relaxed);
      }
    }
  };
  while (true) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_more, queue->WaitForMore(cancellation));
    if (!has_more) {
      return absl::OkStatus();
    }
    arena->execute([&] { tbb::parallel_for(0, arena->max_concurrency(), work_off); });
    absl::MutexLock lock(&mutex);
    ISOSCOPE_RETURN_IF_ERROR(first_error);
  }
}

}  // namespace isoscope::agent
