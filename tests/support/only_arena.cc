#include "tests/support/only_arena.h"

#include <atomic>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/task_arena.h"

namespace isoscope::testing {
namespace {

// On a slow machine under sanitizers, too.
constexpr absl::Duration kPatience = absl::Seconds(120);

std::atomic<int> alive_count{0};

// Returns how many threads of the arena came together: `count`, or fewer after kPatience.
int CountThreads(base::TaskArena* arena, int count) {
  base::Mutex mutex;
  base::CondVar changed;
  int here = 0;
  bool is_late = false;
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  base::RunIn(arena, [&] {
    tbb::parallel_for(
        tbb::blocked_range<int>(0, count),
        [&](const tbb::blocked_range<int>& /*one*/) {
          const base::MutexLock lock(&mutex);
          if (is_late) {
            return;
          }
          if (++here == count) {
            changed.SignalAll();
          }
          // Nobody leaves before all are here, so no thread counts twice.
          is_late = !changed.AwaitUntil(&mutex, deadline, [&] { return here == count || is_late; });
        },
        tbb::simple_partitioner());
  });
  return here;
}

struct OnlyArena {
  OnlyArena() { ISOSCOPE_CHECK_EQ(alive_count.fetch_add(1), 0); }
  ~OnlyArena() {
    arena.reset();
    alive_count.fetch_sub(1);
  }
  OnlyArena(const OnlyArena&) = delete;
  OnlyArena& operator=(const OnlyArena&) = delete;

  std::shared_ptr<base::TaskArena> arena;
};

}  // namespace

absl::StatusOr<std::shared_ptr<base::TaskArena>> MakeOnlyArena(int thread_count) {
  auto only = std::make_shared<OnlyArena>();
  only->arena = std::make_shared<base::TaskArena>(thread_count);
  base::TaskArena* const arena = only->arena.get();
  if (const int count = CountThreads(arena, thread_count); count < thread_count) {
    return absl::DeadlineExceededError(
        absl::StrFormat("of %d threads only %d ran at one time", thread_count, count));
  }
  return std::shared_ptr<base::TaskArena>(std::move(only), arena);
}

}  // namespace isoscope::testing
