#include "partition-agent/memory/queued_reads.h"

#include <algorithm>
#include <deque>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/first_error.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"

namespace isoscope::agent {
namespace {

// The arrivals whose work was interrupted. Thread-safe.
class PausedArrivals {
 public:
  void Put(io::ReadQueue::Arrival arrival) {
    const base::MutexLock lock(&mutex_);
    arrivals_.push_back(std::move(arrival));
  }
  std::optional<io::ReadQueue::Arrival> TryTake() {
    const base::MutexLock lock(&mutex_);
    if (arrivals_.empty()) {
      return std::nullopt;
    }
    std::optional<io::ReadQueue::Arrival> arrival(std::move(arrivals_.front()));
    arrivals_.pop_front();
    return arrival;
  }
  [[nodiscard]] bool empty() const {
    const base::MutexLock lock(&mutex_);
    return arrivals_.empty();
  }

 private:
  mutable base::Mutex mutex_;
  std::deque<io::ReadQueue::Arrival> arrivals_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

absl::Status ForEachArrival(
    io::ReadQueue* queue, base::TaskArena* arena, const base::Cancellation& cancellation,
    absl::FunctionRef<absl::StatusOr<ArrivalWork>(const io::ReadQueue::Arrival&)> work,
    const Pauses& pauses, const ReadWatch& watch) {
  base::FirstError error;
  PausedArrivals paused;
  const auto take = [&]() -> std::optional<io::ReadQueue::Arrival> {
    if (std::optional<io::ReadQueue::Arrival> arrival = paused.TryTake(); arrival.has_value()) {
      return arrival;
    }
    const base::TraceScope read(watch.trace, "read");
    return queue->TryTake();
  };
  const auto work_off = [&](int /*thread*/) {
    while (!error.has_error() && !pauses.is_due()) {
      std::optional<io::ReadQueue::Arrival> arrival = take();
      if (!arrival.has_value()) {
        return;
      }
      if (absl::Status status = cancellation.Check(); !status.ok()) {
        error.Set(std::move(status));
        return;
      }
      const base::TraceScope extract(watch.trace, "extract");
      absl::StatusOr<ArrivalWork> state = work(*arrival);
      if (!state.ok()) {
        error.Set(std::move(state).status());
      } else if (*state == ArrivalWork::kPaused) {
        paused.Put(*std::move(arrival));
      }
    }
  };
  while (true) {
    if (paused.empty()) {  // the queue waits for room, which paused arrivals may take
      base::TraceScope wait(watch.trace, "wait for reads");
      const base::MonotonicTime wait_start = base::MonotonicNow();
      std::optional<FramesInWork::DiskWait> disk_wait(std::in_place, watch.frames);
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_more, queue->WaitForMore(cancellation));
      disk_wait.reset();
      wait.End();
      if (watch.wait != nullptr) {
        watch.wait->Add(std::max(base::MonotonicNow() - wait_start, absl::ZeroDuration()));
      }
      if (!has_more) {
        return absl::OkStatus();
      }
    }
    base::RunIn(arena,
                [&] { tbb::parallel_for(0, tbb::this_task_arena::max_concurrency(), work_off); });
    ISOSCOPE_RETURN_IF_ERROR(error.status());
    if (pauses.is_due()) {
      ISOSCOPE_RETURN_IF_ERROR(pauses.pause());
    }
  }
}

}  // namespace isoscope::agent
