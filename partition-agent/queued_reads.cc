#include "partition-agent/queued_reads.h"

#include <optional>
#include <utility>

#include "absl/status/statusor.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/first_error.h"
#include "core/base/status_macros.h"

namespace isoscope::agent {

absl::Status ForEachArrival(io::ReadQueue* queue, tbb::task_arena* arena,
                            const base::Cancellation& cancellation,
                            absl::FunctionRef<absl::Status(const io::ReadQueue::Arrival&)> work) {
  base::FirstError error;
  const auto work_off = [&](int /*thread*/) {
    while (!error.has_error()) {
      const std::optional<io::ReadQueue::Arrival> arrival = queue->TryTake();
      if (!arrival.has_value()) {
        return;
      }
      absl::Status status = cancellation.Check();
      if (status.ok()) {
        status = work(*arrival);
      }
      error.Set(std::move(status));
    }
  };
  while (true) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_more, queue->WaitForMore(cancellation));
    if (!has_more) {
      return absl::OkStatus();
    }
    arena->execute([&] { tbb::parallel_for(0, arena->max_concurrency(), work_off); });
    ISOSCOPE_RETURN_IF_ERROR(error.status());
  }
}

}  // namespace isoscope::agent
