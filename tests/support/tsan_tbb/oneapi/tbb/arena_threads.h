// A stand-in for what we use of TBB, for ThreadSanitizer: it sees every order between threads, for
// all is made of std::thread and std::atomic and compiled with it. Debian's TBB is not, so that
// every task would look like a race.
//
// It has the names and the contract of oneTBB, at less speed, and is made to show races:
//
// 1. An arena has threads of its own, which sleep until a job comes.
// 2. A job is a number of chunks. The caller takes all sleeping threads of the arena for it, and
//    waits until they are there. Each participant works on a section of the chunks. Nobody takes
//    the first chunk of another's section, so that all have work. The rest they take from each
//    other.
// 3. Participants are ordered by nothing between the start and the end of a job: no lock is shared,
//    and what they count together is counted without order.
//
// Not as in TBB: a thread that waits takes no other work meanwhile; more threads may call execute()
// than the arena has slots; priorities, affinity and task_arena::enqueue are missing.
//
// This header is the inside of the others.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <vector>

namespace tbb {
inline namespace stand_in {

namespace inside {

inline constexpr int kNoLimit = std::numeric_limits<int>::max();

// CPUs that the process may use, and at least 2, so that there are races to see.
inline int DefaultConcurrency() {
  static const int count = [] {
    cpu_set_t set;
    CPU_ZERO(&set);
    return std::max(sched_getaffinity(0, sizeof(set), &set) == 0 ? CPU_COUNT(&set) : 1, 2);
  }();
  return count;
}

// The values of all global_controls.
struct AllowedThreads {
  std::mutex mutex;
  std::multiset<std::size_t> values;
  std::atomic<int> least{kNoLimit};

  static AllowedThreads& Get() {
    static AllowedThreads allowed;
    return allowed;
  }
  // REQUIRES: mutex is held.
  void Update() {
    least = values.empty()
                ? kNoLimit
                : static_cast<int>(std::clamp<std::size_t>(*values.begin(), 1, kNoLimit));
  }
};

// Set in the child of a fork, which has none of the threads.
inline std::atomic<bool>& IsForked() {
  static std::atomic<bool> forked{false};
  static const int registered =
      pthread_atfork(nullptr, nullptr, [] { IsForked().store(true, std::memory_order_relaxed); });
  static_cast<void>(registered);
  return forked;
}

// What several participants work on. Each calls Work(its number) once.
class Job {
 public:
  Job(std::size_t chunk_count, std::function<void(std::size_t)> chunk,
      const std::atomic<bool>* cancelled)
      : chunk_count_(chunk_count), chunk_(std::move(chunk)), cancelled_(cancelled) {}

  // Before any participant comes. At most chunk_count.
  void SetParticipants(std::size_t count) {
    participants_ = count;
    sections_ = std::vector<Section>(count);
    for (std::size_t i = 0; i < count; ++i) {
      sections_[i].end = chunk_count_ * (i + 1) / count;
      sections_[i].next.store(chunk_count_ * i / count + 1, std::memory_order_relaxed);
    }
  }

  // Waits until all participants are there, then works until no chunk is left.
  void Work(std::size_t participant) {
    arrived_.fetch_add(1, std::memory_order_relaxed);
    while (arrived_.load(std::memory_order_relaxed) < participants_) {
      std::this_thread::yield();
    }
    RunChunk(chunk_count_ * participant / participants_);
    for (std::size_t i = 0; i < participants_; ++i) {
      Section& section = sections_[(participant + i) % participants_];
      while (true) {
        const std::size_t chunk = section.next.fetch_add(1, std::memory_order_relaxed);
        if (chunk >= section.end) {
          break;
        }
        RunChunk(chunk);
      }
    }
  }

  // The last that a participant does with the job.
  void Leave() {
    left_.fetch_add(1, std::memory_order_release);
    left_.notify_all();
  }

  // Waits until `count` participants have left.
  void Await(int count) const {
    for (int left = left_.load(std::memory_order_acquire); left < count;
         left = left_.load(std::memory_order_acquire)) {
      left_.wait(left, std::memory_order_acquire);
    }
  }

  // After Await(): throws what the first failed chunk threw.
  void Rethrow() const {
    if (exception_ != nullptr) {
      std::rethrow_exception(exception_);
    }
  }

 private:
  struct Section {
    std::atomic<std::size_t> next{0};
    std::size_t end = 0;
  };

  void RunChunk(std::size_t chunk) {
    if (has_failed_.load(std::memory_order_relaxed) ||
        (cancelled_ != nullptr && cancelled_->load(std::memory_order_relaxed))) {
      return;
    }
    try {
      chunk_(chunk);
    } catch (...) {
      if (!has_failed_.exchange(true, std::memory_order_relaxed)) {
        exception_ = std::current_exception();
      }
    }
  }

  const std::size_t chunk_count_;
  const std::function<void(std::size_t)> chunk_;
  const std::atomic<bool>* const cancelled_;
  std::size_t participants_ = 1;
  std::vector<Section> sections_;
  std::atomic<std::size_t> arrived_{0};
  std::atomic<int> left_{0};
  std::atomic<bool> has_failed_{false};
  std::exception_ptr exception_;  // of the thread that set has_failed_
};

class Arena;

// The arena that a thread is in, and its slot there.
struct Place {
  Arena* arena = nullptr;
  int slot = -1;
};
inline Place& ThisPlace() {
  thread_local Place place;
  return place;
}

// Is told when threads enter and leave an arena.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void on_scheduler_entry(bool /*is_worker*/) {}
  virtual void on_scheduler_exit(bool /*is_worker*/) {}
};

// The threads of one task_arena. Callers are in slot 0, however many they are.
class Arena {
 public:
  explicit Arena(int concurrency) : concurrency_(concurrency) { IsForked(); }
  ~Arena() {
    for (const std::unique_ptr<Worker>& worker : workers_) {
      if (IsForked()) {
        worker->thread.detach();
        continue;
      }
      while (!worker->Claim()) {
        std::this_thread::yield();
      }
      worker->Give(nullptr, 0);
      worker->thread.join();
    }
  }
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;

  // The arena that the calling thread is in, or that of all threads that are in none.
  static Arena& Current() {
    static Arena implicit(0);
    Arena* const arena = ThisPlace().arena;
    return arena != nullptr ? *arena : implicit;
  }

  // Threads that may work at once, the caller's with them.
  [[nodiscard]] int concurrency() const {
    if (concurrency_ > 0) {
      return concurrency_;
    }
    const int allowed = AllowedThreads::Get().least.load(std::memory_order_relaxed);
    return allowed == kNoLimit ? DefaultConcurrency() : std::min(allowed, kMaxImplicit);
  }

  // Calls chunk(i) for all i below `chunk_count`, in parallel, unless `cancelled` becomes true or a
  // chunk throws; then throws what the first one threw.
  void Run(std::size_t chunk_count, std::function<void(std::size_t)> chunk,
           const std::atomic<bool>* cancelled = nullptr) {
    if (chunk_count == 0) {
      return;
    }
    const Enter inside(this);
    const auto job = std::make_shared<Job>(chunk_count, std::move(chunk), cancelled);
    const std::vector<Worker*> helpers =
        ClaimWorkers(std::min(chunk_count, static_cast<std::size_t>(Allowed())) - 1);
    job->SetParticipants(helpers.size() + 1);
    for (std::size_t i = 0; i < helpers.size(); ++i) {
      helpers[i]->Give(job, i + 1);
    }
    job->Work(0);
    job->Await(static_cast<int>(helpers.size()));
    job->Rethrow();
  }

  // Has a sleeping thread do `job`, which is for one participant. False if there is none.
  bool Hand(const std::shared_ptr<Job>& job) {
    const std::vector<Worker*> helpers = ClaimWorkers(Allowed() < 2 ? 0 : 1);
    if (helpers.empty()) {
      return false;
    }
    helpers[0]->Give(job, 0);
    return true;
  }

  // Makes the calling thread one of the arena's while it lives.
  class Enter {
   public:
    explicit Enter(Arena* arena) : before_(ThisPlace()) {
      if (before_.arena != arena) {
        ThisPlace() = {arena, 0};
        arena->TellEntry(false);
      }
    }
    ~Enter() {
      Arena* const arena = ThisPlace().arena;
      if (before_.arena != arena) {
        arena->TellExit(false);
        ThisPlace() = before_;
      }
    }
    Enter(const Enter&) = delete;
    Enter& operator=(const Enter&) = delete;

   private:
    const Place before_;
  };

  void AddObserver(Observer* observer) {
    const std::lock_guard<std::mutex> lock(observers_mutex_);
    observers_.push_back(observer);
  }
  void RemoveObserver(Observer* observer) {
    const std::lock_guard<std::mutex> lock(observers_mutex_);
    observers_.erase(std::remove(observers_.begin(), observers_.end(), observer), observers_.end());
  }

 private:
  static constexpr int kMaxImplicit = 8;  // threads of the arena of those that are in none

  // A thread, and what it is to do next.
  class Worker {
   public:
    Worker(Arena* arena, int slot) : thread([this, arena, slot] { Loop(arena, slot); }) {}

    // True if the thread slept: it then waits for Give(). Without order, so that the caller learns
    // nothing of what the thread did before.
    bool Claim() {
      int expected = kSleeping;
      return state_.compare_exchange_strong(expected, kClaimed, std::memory_order_relaxed);
    }
    // After Claim(). No job: the thread ends.
    void Give(std::shared_ptr<Job> job, std::size_t participant) {
      order_.store(new Order{std::move(job), participant}, std::memory_order_relaxed);
      state_.store(kGiven, std::memory_order_release);
      state_.notify_all();
    }

   private:
    static constexpr int kSleeping = 0;
    static constexpr int kClaimed = 1;
    static constexpr int kGiven = 2;

    struct Order {
      std::shared_ptr<Job> job;
      std::size_t participant;
    };

    void Loop(Arena* arena, int slot) {
      ThisPlace() = {arena, slot};
      while (true) {
        for (int state = state_.load(std::memory_order_acquire); state != kGiven;
             state = state_.load(std::memory_order_acquire)) {
          state_.wait(state, std::memory_order_relaxed);
        }
        const std::unique_ptr<Order> order(order_.load(std::memory_order_relaxed));
        if (order->job == nullptr) {
          return;
        }
        arena->TellEntry(true);
        order->job->Work(order->participant);
        arena->TellExit(true);
        state_.store(kSleeping, std::memory_order_relaxed);
        order->job->Leave();
      }
    }

    std::atomic<int> state_{kSleeping};
    std::atomic<Order*> order_{nullptr};

   public:
    std::thread thread;  // the last member: it uses the others
  };

  [[nodiscard]] int Allowed() const {
    return std::min(concurrency(), AllowedThreads::Get().least.load(std::memory_order_relaxed));
  }

  std::vector<Worker*> ClaimWorkers(std::size_t wanted) {
    std::vector<Worker*> claimed;
    if (wanted == 0 || IsForked().load(std::memory_order_relaxed)) {
      return claimed;
    }
    std::call_once(started_, [this] {
      const int count =
          concurrency_ > 0 ? concurrency_ : std::max(kMaxImplicit, DefaultConcurrency());
      for (int slot = 1; slot < count; ++slot) {
        workers_.push_back(std::make_unique<Worker>(this, slot));
      }
    });
    for (std::size_t i = 0; i < workers_.size() && claimed.size() < wanted; ++i) {
      if (workers_[i]->Claim()) {
        claimed.push_back(workers_[i].get());
      }
    }
    return claimed;
  }

  std::vector<Observer*> Observers() {
    const std::lock_guard<std::mutex> lock(observers_mutex_);
    return observers_;
  }
  void TellEntry(bool is_worker) {
    for (Observer* const observer : Observers()) {
      observer->on_scheduler_entry(is_worker);
    }
  }
  void TellExit(bool is_worker) {
    for (Observer* const observer : Observers()) {
      observer->on_scheduler_exit(is_worker);
    }
  }

  const int concurrency_;  // 0: the implicit arena
  std::once_flag started_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::mutex observers_mutex_;
  std::vector<Observer*> observers_;
};

}  // namespace inside
}  // namespace stand_in
}  // namespace tbb

namespace oneapi {
namespace tbb = ::tbb;
}

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_
