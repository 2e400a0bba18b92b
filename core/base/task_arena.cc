// An arena places its threads on CPUs. In virtual machines the kernel was seen to wake several
// threads on one CPU, and to leave another one idle for milliseconds.
//
// 1. MakeTaskArena makes the arena. If the arena is as wide as the list of CPUs that the process
//    may use, a Placement gets that list. It is rotated by a random amount, so that the first slots
//    of many processes do not meet on one CPU.
// 2. TBB calls the Placement whenever a thread enters the arena. The thread's slot is an index into
//    the list. A worker of TBB is bound to its CPU once and stays bound while it sleeps. A thread
//    that called execute() belongs to someone else. It is bound to the CPU and at once unbound,
//    which moves it there and leaves it free.
// 3. ~Placement waits until all threads have left the arena, at most 5 s, because TBB frees its
//    record of an observer only then.
//
// An arena of any other width, or of one CPU, has no Placement: the kernel places its threads.

#include "core/base/task_arena.h"

#include <sched.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_scheduler_observer.h>

#include "core/base/mutex.h"

namespace isoscope::base {
namespace {

// The longest wait for threads to leave an arena. It allows for a machine under heavy load.
constexpr absl::Duration kMaxLeaveDuration = absl::Seconds(5);

// Returns the CPUs that this thread may use, ascending. Empty if there are more than cpu_set_t can
// hold.
std::vector<int> AllowedCpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) {
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
      if (CPU_ISSET(static_cast<std::size_t>(cpu), &set)) {
        cpus.push_back(cpu);
      }
    }
  }
  return cpus;
}

// Ignores errors: the thread then stays where the kernel has put it.
void BindThisThread(const std::vector<int>& cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) {
    CPU_SET(static_cast<std::size_t>(cpu), &set);
  }
  sched_setaffinity(0, sizeof(set), &set);
}

// Puts each thread that enters an arena on the CPU of its slot.
class Placement final : public tbb::task_scheduler_observer {
 public:
  // `cpus` has a CPU for each slot of the arena.
  Placement(tbb::task_arena* arena, std::vector<int> cpus)
      : tbb::task_scheduler_observer(*arena), cpus_(std::move(cpus)) {
    observe(true);
  }
  // TBB frees its record of an observer when the last worker has left the arena, some microseconds
  // after the last work. A process that ends before that would leak it.
  ~Placement() override {
    {
      MutexLock lock(&mutex_);
      emptied_.AwaitUntil(&mutex_, absl::Now() + kMaxLeaveDuration,
                          [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return inside_ == 0; });
    }
    observe(false);
  }

  void on_scheduler_entry(bool is_worker) override {
    {
      const MutexLock lock(&mutex_);
      ++inside_;
    }
    const auto slot = static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
    if (slot >= cpus_.size()) {
      return;
    }
    const int cpu = cpus_[slot];
    if (is_worker) {
      // The worker stays bound while it sleeps. Otherwise the kernel could wake it on any CPU.
      thread_local int bound_cpu = -1;
      if (std::exchange(bound_cpu, cpu) != cpu) {
        BindThisThread({cpu});
      }
    } else if (sched_getcpu() != cpu) {
      const std::vector<int> allowed = AllowedCpus();
      BindThisThread({cpu});
      BindThisThread(allowed);
    }
  }
  void on_scheduler_exit(bool /*is_worker*/) override {
    const MutexLock lock(&mutex_);
    if (--inside_ == 0) {
      emptied_.SignalAll();
    }
  }

 private:
  const std::vector<int> cpus_;
  Mutex mutex_;
  CondVar emptied_;
  int inside_ ABSL_GUARDED_BY(mutex_) = 0;
};

// The arena of the scope that this thread is in.
thread_local tbb::task_arena* scope_arena = nullptr;

struct PlacedArena {
  // TBB makes more threads than there are CPUs only if this allows them.
  std::optional<tbb::global_control> allowed_threads;
  tbb::task_arena arena;
  std::optional<Placement> placement;  // none: threads are where the kernel puts them
};

}  // namespace

std::shared_ptr<tbb::task_arena> MakeTaskArena(int thread_count) {
  auto placed = std::make_shared<PlacedArena>();
  if (thread_count > 0) {
    placed->allowed_threads.emplace(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(thread_count));
    placed->arena.initialize(thread_count);
  }
  std::vector<int> cpus = AllowedCpus();
  if (cpus.size() > 1 && cpus.size() == static_cast<std::size_t>(placed->arena.max_concurrency())) {
    const std::size_t first = std::random_device{}() % cpus.size();
    std::rotate(cpus.begin(), cpus.begin() + static_cast<std::ptrdiff_t>(first), cpus.end());
    placed->placement.emplace(&placed->arena, std::move(cpus));
  }
  tbb::task_arena* const arena = &placed->arena;
  return {std::move(placed), arena};
}

OneThreadScope::OneThreadScope() : before_(scope_arena) {
  thread_local tbb::task_arena alone(1);
  scope_arena = &alone;
}

OneThreadScope::~OneThreadScope() { scope_arena = before_; }

tbb::task_arena& ArenaOfThisThread(tbb::task_arena* arena) {
  return scope_arena != nullptr ? *scope_arena : *arena;
}

}  // namespace isoscope::base
