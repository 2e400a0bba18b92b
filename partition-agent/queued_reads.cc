#include "partition-agent/queued_reads.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/first_error.h"
#include "core/base/status_macros.h"

namespace isoscope::agent {

absl::Status ForEachArrival(io::ReadQueue* queue, tbb::task_arena* arena,
                            const base::Cancellation& cancellation,
                            absl::FunctionRef<absl::Status(const io::ReadQueue::Arrival&)> work,
                            const ReadWatch& watch) {
  base::FirstError error;
  const auto work_off = [&](int /*thread*/) {
    while (!error.has_error()) {
      base::TraceScope read(watch.trace, "read");
      const std::optional<io::ReadQueue::Arrival> arrival = queue->TryTake();
      read.End();
      if (!arrival.has_value()) {
        return;
      }
      absl::Status status = cancellation.Check();
      if (status.ok()) {
        const base::TraceScope extract(watch.trace, "extract");
        status = work(*arrival);
      }
      error.Set(std::move(status));
    }
  };
  while (true) {
    base::TraceScope wait(watch.trace, "wait for reads");
    const absl::Time wait_start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_more, queue->WaitForMore(cancellation));
    wait.End();
    if (watch.wait != nullptr) {
      watch.wait->Add(std::max(absl::Now() - wait_start, absl::ZeroDuration()));
    }
    if (!has_more) {
      return absl::OkStatus();
    }
    arena->execute([&] { tbb::parallel_for(0, arena->max_concurrency(), work_off); });
    ISOSCOPE_RETURN_IF_ERROR(error.status());
  }
}

}  // namespace isoscope::agent
