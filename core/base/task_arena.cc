// An arena places its threads on CPUs. In virtual machines the kernel was seen to wake several
// threads on one CPU, and to leave another one idle for milliseconds.
//
// 1. If the arena is as wide as the list of CPUs that the process may use, an Observer gets that
//    list. It is rotated by a random amount, so that the first slots of many processes do not meet
//    on one CPU.
// 2. TBB calls the Observer whenever a thread enters the arena. The thread's slot is an index into
//    the list. A worker of TBB is bound to its CPU once and stays bound while it sleeps. A thread
//    that called execute() belongs to someone else. It is bound to the CPU and at once unbound,
//    which moves it there and leaves it free.
// 3. ~Observer waits until all threads have left the arena, at most 5 s, because TBB frees its
//    record of an observer only then.
//
// An arena of any other width, or of one CPU, gets no such list: the kernel places its threads.
//
// With shared threads there are as many permits as threads, and no thread computes without one:
//
//   thread                           takes                          computes
//   in a OneThreadScope              one, or waits for one          alone
//   another one                      all, if nobody has any         in the arena
//                                    else one, or waits for one     alone
//   in RunIn already, or a worker    none: the entry has them       where it is

#include "core/base/task_arena.h"

#include <sched.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_scheduler_observer.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::base {
namespace {

// The longest wait for threads to leave an arena. It allows for a machine under heavy load.
constexpr absl::Duration kMaxLeaveDuration = absl::Seconds(5);

// A thread that waits for a permit is overtaken for at most this long.
constexpr absl::Duration kMaxOvertakingDuration = absl::Milliseconds(10);

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

// One for each thread that may compute at a time.
class ThreadPermits {
 public:
  explicit ThreadPermits(int count) : count_(count), free_count_(count) {}

  // Threads that wait are served in order. Another one may overtake them, because its CPU has
  // nothing to do until the one that waits has woken. With handing over in order, frames of 16 and
  // 64 agents took 1.09 of their time.
  void TakeOne() ABSL_LOCKS_EXCLUDED(mutex_) {
    MutexLock lock(&mutex_);
    if (free_count_ > 0 &&
        (first_ == nullptr || MonotonicNow() - first_->start < kMaxOvertakingDuration)) {
      --free_count_;
      return;
    }
    Waiter waiter;
    (first_ == nullptr ? first_ : last_->next) = &waiter;
    last_ = &waiter;
    waiter.wake.Await(&mutex_, [&]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return free_count_ > 0 && first_ == &waiter;
    });
    first_ = waiter.next;
    --free_count_;
    WakeFirst();
  }
  // Returns false if another thread has a permit or waits for one.
  bool TryTakeAll() ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(&mutex_);
    if (free_count_ < count_ || first_ != nullptr) {
      return false;
    }
    free_count_ = 0;
    return true;
  }
  void Return(int permit_count) ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(&mutex_);
    free_count_ += permit_count;
    WakeFirst();
  }
  [[nodiscard]] int count() const { return count_; }

 private:
  // On the stack of the thread that waits.
  struct Waiter {
    const MonotonicTime start = MonotonicNow();
    CondVar wake;
    Waiter* next = nullptr;
  };

  void WakeFirst() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (free_count_ > 0 && first_ != nullptr) {
      first_->wake.Signal();
    }
  }

  const int count_;
  Mutex mutex_;
  int free_count_ ABSL_GUARDED_BY(mutex_);
  Waiter* first_ ABSL_GUARDED_BY(mutex_) = nullptr;  // has waited longest
  Waiter* last_ ABSL_GUARDED_BY(mutex_) = nullptr;   // only if there is a first one
};

// They belong to this thread.
thread_local bool is_in_one_thread_scope = false;
// The arena with shared threads that this thread computes for, and where.
thread_local const void* computes_for = nullptr;
thread_local tbb::task_arena* computes_in = nullptr;

tbb::task_arena& AloneOnThisThread() {
  thread_local tbb::task_arena alone(1);
  return alone;
}

// Sees each thread that enters or leaves an arena.
class Observer final : public tbb::task_scheduler_observer {
 public:
  // cpus:  has a CPU for each slot of the arena, or none: then threads stay where they are
  // owner: what the workers compute for; null: nobody asks
  Observer(tbb::task_arena* arena, std::vector<int> cpus, const void* owner)
      : tbb::task_scheduler_observer(*arena), arena_(arena), cpus_(std::move(cpus)), owner_(owner) {
    observe(true);
  }
  // TBB frees its record of an observer when the last worker has left the arena, some microseconds
  // after the last work. A process that ends before that would leak it.
  ~Observer() override {
    {
      MutexLock lock(&mutex_);
      emptied_.AwaitUntil(&mutex_, MonotonicNow() + kMaxLeaveDuration,
                          [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return inside_ == 0; });
    }
    observe(false);
  }

  void on_scheduler_entry(bool is_worker) override {
    {
      const MutexLock lock(&mutex_);
      ++inside_;
    }
    if (is_worker && owner_ != nullptr) {
      computes_for = owner_;
      computes_in = arena_;
    }
    const auto slot = static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
    if (slot < cpus_.size()) {
      Place(is_worker, cpus_[slot]);
    }
  }
  void on_scheduler_exit(bool is_worker) override {
    if (is_worker && owner_ != nullptr) {
      computes_for = nullptr;
      computes_in = nullptr;
    }
    const MutexLock lock(&mutex_);
    if (--inside_ == 0) {
      emptied_.SignalAll();
    }
  }

 private:
  static void Place(bool is_worker, int cpu) {
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

  tbb::task_arena* const arena_;
  const std::vector<int> cpus_;
  const void* const owner_;
  Mutex mutex_;
  CondVar emptied_;
  int inside_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace

struct TaskArena::Parts {
  // TBB makes more threads than there are CPUs only if this allows them.
  std::optional<tbb::global_control> allowed_threads;
  tbb::task_arena arena;
  std::optional<ThreadPermits> permits;  // none: threads are not shared
  std::vector<int> cpus;                 // by slot; empty: threads are where the kernel puts them
  std::optional<Observer> observer;      // with CPUs, or with permits
};

TaskArena::TaskArena(int thread_count) : parts_(std::make_unique<Parts>()) {
  if (thread_count > 0) {
    parts_->allowed_threads.emplace(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(thread_count));
    parts_->arena.initialize(thread_count);
  }
  std::vector<int> cpus = AllowedCpus();
  if (cpus.size() > 1 && cpus.size() == static_cast<std::size_t>(max_concurrency())) {
    const std::size_t first = std::random_device{}() % cpus.size();
    std::rotate(cpus.begin(), cpus.begin() + static_cast<std::ptrdiff_t>(first), cpus.end());
    parts_->cpus = std::move(cpus);
  }
  SetSharesThreads(false);
}

TaskArena::~TaskArena() = default;

int TaskArena::max_concurrency() const { return parts_->arena.max_concurrency(); }

void TaskArena::SetSharesThreads(bool shares_threads) {
  parts_->permits.reset();
  parts_->observer.reset();
  if (shares_threads) {
    parts_->permits.emplace(max_concurrency());
    parts_->observer.emplace(&parts_->arena, parts_->cpus, parts_.get());
  } else if (!parts_->cpus.empty()) {
    parts_->observer.emplace(&parts_->arena, parts_->cpus, nullptr);
  }
}

bool TaskArena::shares_threads() const { return parts_->permits.has_value(); }

OneThreadScope::OneThreadScope()
    : was_inside_another_(std::exchange(is_in_one_thread_scope, true)) {}

OneThreadScope::~OneThreadScope() { is_in_one_thread_scope = was_inside_another_; }

int ConcurrencyOf(const TaskArena& arena) {
  return is_in_one_thread_scope ? 1 : arena.max_concurrency();
}

ArenaEntry::ArenaEntry(TaskArena* arena) : parts_(*arena->parts_) {
  if (!parts_.permits.has_value()) {
    arena_ = is_in_one_thread_scope ? &AloneOnThisThread() : &parts_.arena;
    return;
  }
  if (computes_for == &parts_) {
    arena_ = computes_in;
    return;
  }
  if (!is_in_one_thread_scope && parts_.permits->TryTakeAll()) {
    permit_count_ = parts_.permits->count();
    arena_ = &parts_.arena;
  } else {
    parts_.permits->TakeOne();
    permit_count_ = 1;
    arena_ = &AloneOnThisThread();
  }
  computes_for = &parts_;
  computes_in = arena_;
}

ArenaEntry::~ArenaEntry() {
  if (permit_count_ > 0) {
    computes_for = nullptr;
    computes_in = nullptr;
    parts_.permits->Return(permit_count_);
  }
}

}  // namespace isoscope::base
