// A stand-in for the parts of TBB that we use, for ThreadSanitizer. It consists of std::thread and
// std::atomic and is compiled with the sanitizer, which therefore sees every order between threads.
// Debian's TBB is not, so every task would look like a race.
//
// It has the names and the contract of oneTBB, is slower, and is designed to expose races:
//
// 1. An arena has threads of its own, which sleep until a job comes.
// 2. A job is a number of chunks. The caller takes all sleeping threads of the arena for it, and
//    waits until they are there. Each participant has one chunk of its own, so that all have work.
//    The other chunks are free.
// 3. Jobs with free chunks are on the board of their arena. A thread that has done its chunk takes
//    free ones from the board, of the newest job first, until there are none. A thread that waits
//    for the end of a job takes them meanwhile. So a task may run on a thread in the middle of
//    another task, which holds locks and uses the thread's elements. In an isolated region a thread
//    takes only that region's chunks.
// 4. Nothing orders threads between the start and the end of a job: they share no lock, and their
//    common counters are unordered. Reading the board orders nothing. Taking a chunk orders a
//    thread after the start of its job, and the end of the job after that thread.
//
// Differences from TBB: steps of a pipeline stay with its participants, who wait for their turns;
// more threads may call execute() than the arena has slots; priorities, affinity and
// task_arena::enqueue are missing.
//
// The other headers of the stand-in include this one.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_

#include <pthread.h>
#include <sched.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include <linux/futex.h>
#include <sys/syscall.h>

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

// Sleeps while `word` is `value`, at most for `longest`; null: without limit. std::atomic::wait
// would order the one that wakes after all that sleep.
inline void SleepWhile(const std::atomic<int>& word, int value, const timespec* longest) {
  static_assert(sizeof(word) == sizeof(int));
  syscall(SYS_futex, &word, FUTEX_WAIT_PRIVATE, value, longest, nullptr, 0);
}
inline void WakeAll(const std::atomic<int>& word) {
  syscall(SYS_futex, &word, FUTEX_WAKE_PRIVATE, std::numeric_limits<int>::max(), nullptr, nullptr,
          0);
}

class Arena;

// Where a thread is.
struct Place {
  Arena* arena = nullptr;
  int slot = -1;             // of the arena
  std::uint64_t region = 0;  // the isolated one that it is in; 0: none
  int depth = 0;             // chunks of others that it is in the middle of
};
inline Place& ThisPlace() {
  thread_local Place place;
  return place;
}

// Puts the calling thread into an isolated region while it lives.
class InRegion {
 public:
  explicit InRegion(std::uint64_t region) : before_(std::exchange(ThisPlace().region, region)) {}
  ~InRegion() { ThisPlace().region = before_; }
  InRegion(const InRegion&) = delete;
  InRegion& operator=(const InRegion&) = delete;

  static std::uint64_t New() {
    static std::atomic<std::uint64_t> last{0};
    return last.fetch_add(1, std::memory_order_relaxed) + 1;
  }

 private:
  const std::uint64_t before_;
};

class Job;

// A place on the board of an arena, which shows a job to those who are not its participants. They
// may use the job only between joining and leaving it: its owner waits for them. A notice outlives
// all jobs that it shows, so that anyone may look at it at any time.
struct Notice {
  // Bits of `state`. An owned notice belongs to one job; only an open one can be joined.
  static constexpr std::uint64_t kOwned = 1;
  static constexpr std::uint64_t kOpen = 2;
  static constexpr std::uint64_t kGuest = 4;  // times the number of those that have ever joined

  std::atomic<std::uint64_t> state{0};
  std::atomic<std::uint64_t> number{0};  // of the job
  std::atomic<std::uint64_t> region{0};  // of the job
  std::atomic<std::size_t> free_chunks{0};
  std::atomic<Job*> job{nullptr};

  // Shows a job. False if the notice is another's.
  bool Open(Job* shown, std::uint64_t its_number, std::uint64_t its_region, std::size_t count) {
    std::uint64_t expected = 0;
    if (!state.compare_exchange_strong(expected, kOwned, std::memory_order_relaxed)) {
      return false;
    }
    number.store(its_number, std::memory_order_relaxed);
    region.store(its_region, std::memory_order_relaxed);
    free_chunks.store(count, std::memory_order_relaxed);
    job.store(shown, std::memory_order_relaxed);
    state.store(kOwned | kOpen, std::memory_order_release);
    return true;
  }
  // The job if it can be joined: then it waits for the thread to leave it. Null otherwise.
  Job* Join() {
    std::uint64_t seen = state.load(std::memory_order_relaxed);
    while ((seen & kOpen) != 0) {
      if (state.compare_exchange_weak(seen, seen + kGuest, std::memory_order_acquire,
                                      std::memory_order_relaxed)) {
        return job.load(std::memory_order_relaxed);
      }
    }
    return nullptr;
  }
  // Nobody can join any more. Returns how many have.
  std::size_t Close() {
    return static_cast<std::size_t>(state.fetch_and(~kOpen, std::memory_order_relaxed) / kGuest);
  }
  // After all that joined have left.
  void Free() { state.store(0, std::memory_order_relaxed); }
};
using Board = std::array<Notice, 64>;

// Chunks of work. The maker of a job waits until all its participants have left it.
class Job {
 public:
  // `number`: larger than those of older jobs of the arena. The job is in the isolated region that
  // the calling thread is in.
  Job(std::uint64_t number, std::size_t chunk_count, std::function<void(std::size_t)> chunk,
      const std::atomic<bool>* cancelled)
      : number_(number),
        region_(ThisPlace().region),
        chunk_count_(chunk_count),
        chunk_(std::move(chunk)),
        cancelled_(cancelled) {}

  [[nodiscard]] std::uint64_t region() const { return region_; }
  [[nodiscard]] Notice* notice() const { return notice_; }  // null: the job is not on the board

  // Before any thread comes. At most chunk_count. As many chunks are their own, the others free.
  void SetParticipants(std::size_t count) {
    participants_ = count;
    next_free_.store(count, std::memory_order_relaxed);
  }
  // Before any thread comes. Does nothing if no chunk is free, or no notice.
  void PutOn(Board* board) {
    if (!HasFree()) {
      return;
    }
    for (Notice& notice : *board) {
      notice_ = &notice;
      if (notice.Open(this, number_, region_, chunk_count_ - participants_)) {
        return;
      }
    }
    notice_ = nullptr;
  }

  // Waits until all participants are there, then does the own chunk of this one.
  void RunOwn(std::size_t participant) {
    arrived_.fetch_add(1, std::memory_order_relaxed);
    while (arrived_.load(std::memory_order_relaxed) < participants_) {
      std::this_thread::yield();
    }
    RunChunk(participant);
  }
  // Does a free chunk. False if there is none.
  bool RunFree() {
    const std::size_t chunk =
        HasFree() ? next_free_.fetch_add(1, std::memory_order_relaxed) : chunk_count_;
    if (chunk >= chunk_count_) {
      return false;
    }
    if (notice_ != nullptr) {
      notice_->free_chunks.fetch_sub(1, std::memory_order_relaxed);
    }
    RunChunk(chunk);
    return true;
  }
  [[nodiscard]] bool HasFree() const {
    return next_free_.load(std::memory_order_relaxed) < chunk_count_;
  }

  // The last that a thread does with the job.
  void Leave() { left_.fetch_add(1, std::memory_order_release); }
  // True if `count` threads have left. Orders nothing.
  [[nodiscard]] bool IsLeftBy(std::size_t count) const {
    return left_.load(std::memory_order_relaxed) >= count;
  }
  // After all have left: throws what the first failed chunk threw.
  void End() const {
    left_.load(std::memory_order_acquire);
    if (exception_ != nullptr) {
      std::rethrow_exception(exception_);
    }
  }

 private:
  void RunChunk(std::size_t chunk) {
    if (has_failed_.load(std::memory_order_relaxed) ||
        (cancelled_ != nullptr && cancelled_->load(std::memory_order_relaxed))) {
      return;
    }
    const InRegion inside(region_);
    try {
      chunk_(chunk);
    } catch (...) {
      if (!has_failed_.exchange(true, std::memory_order_relaxed)) {
        exception_ = std::current_exception();
      }
    }
  }

  const std::uint64_t number_;
  const std::uint64_t region_;
  const std::size_t chunk_count_;
  const std::function<void(std::size_t)> chunk_;
  const std::atomic<bool>* const cancelled_;
  std::size_t participants_ = 0;
  Notice* notice_ = nullptr;
  std::atomic<std::size_t> next_free_{0};
  std::atomic<std::size_t> arrived_{0};
  std::atomic<std::size_t> left_{0};
  std::atomic<bool> has_failed_{false};
  std::exception_ptr exception_;  // of the thread that set has_failed_
};

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

  // Who does the chunks of a job.
  enum class Takers { kAnyone, kParticipants };

  // Calls chunk(i) for all i below `chunk_count`, in parallel, unless `cancelled` becomes true or a
  // chunk throws; then throws what the first one threw.
  void Run(std::size_t chunk_count, std::function<void(std::size_t)> chunk,
           const std::atomic<bool>* cancelled = nullptr, Takers takers = Takers::kAnyone) {
    if (chunk_count == 0) {
      return;
    }
    const Enter inside(this);
    Job job(NewNumber(), chunk_count, std::move(chunk), cancelled);
    const std::vector<Worker*> helpers =
        ClaimWorkers(std::min(chunk_count, static_cast<std::size_t>(Allowed())) - 1);
    job.SetParticipants(helpers.size() + 1);
    if (takers == Takers::kAnyone) {
      Show(&job);
    }
    for (std::size_t i = 0; i < helpers.size(); ++i) {
      helpers[i]->Give(&job, i + 1);
    }
    job.RunOwn(0);
    Finish(&job, helpers.size());
  }

  // A job of one chunk, which a sleeping thread does, or else anyone in time. Finish() ends it.
  struct Task {
    std::unique_ptr<Job> job;
    std::size_t participants = 0;
  };
  Task Start(std::function<void(std::size_t)> chunk) {
    Task task{std::make_unique<Job>(NewNumber(), 1, std::move(chunk), nullptr)};
    const std::vector<Worker*> helpers = ClaimWorkers(Allowed() < 2 ? 0 : 1);
    task.participants = helpers.size();
    task.job->SetParticipants(helpers.size());
    if (helpers.empty()) {
      Show(task.job.get());
    } else {
      helpers[0]->Give(task.job.get(), 0);
    }
    return task;
  }

  // Does what is free of a job, and waits for the end of the rest. `participants`: without the
  // calling thread. Throws what the first failed chunk threw.
  void Finish(Job* job, std::size_t participants) {
    while (job->RunFree()) {
    }
    const std::size_t guests = job->notice() != nullptr ? job->notice()->Close() : 0;
    Await(*job, participants + guests);
    if (job->notice() != nullptr) {
      job->notice()->Free();
    }
    job->End();
  }

  // Makes the calling thread one of the arena's while it lives.
  class Enter {
   public:
    explicit Enter(Arena* arena) : before_(ThisPlace()) {
      if (before_.arena != arena) {
        ThisPlace() = {.arena = arena, .slot = 0, .depth = before_.depth};
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
    has_observers_ = true;
  }
  void RemoveObserver(Observer* observer) {
    const std::lock_guard<std::mutex> lock(observers_mutex_);
    observers_.erase(std::remove(observers_.begin(), observers_.end(), observer), observers_.end());
    has_observers_ = !observers_.empty();
  }

 private:
  static constexpr int kMaxImplicit = 8;  // threads of the arena of those that are in none
  static constexpr int kMaxDepth = 16;    // so that stacks do not overflow
  // The longest sleep of a thread that waits. It is woken, but nothing orders that.
  static constexpr timespec kLongestSleep{.tv_sec = 0, .tv_nsec = 10'000'000};

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
    void Give(Job* job, std::size_t participant) {
      order_.store(new Order{job, participant}, std::memory_order_relaxed);
      state_.store(kGiven, std::memory_order_release);
      WakeAll(state_);
    }

   private:
    static constexpr int kSleeping = 0;
    static constexpr int kClaimed = 1;
    static constexpr int kGiven = 2;

    struct Order {
      Job* job;
      std::size_t participant;
    };

    void Loop(Arena* arena, int slot) {
      ThisPlace() = {.arena = arena, .slot = slot};
      while (true) {
        for (int state = state_.load(std::memory_order_acquire); state != kGiven;
             state = state_.load(std::memory_order_acquire)) {
          SleepWhile(state_, state, nullptr);
        }
        const std::unique_ptr<Order> order(order_.load(std::memory_order_relaxed));
        if (order->job == nullptr) {
          return;
        }
        arena->TellEntry(true);
        Job* job = order->job;
        job->RunOwn(order->participant);
        for (Job* next = arena->Join(); next != nullptr; next = arena->Join()) {
          arena->Leave(std::exchange(job, next));
          job->RunFree();
        }
        arena->TellExit(true);
        // The waiting caller can take the thread for its next job.
        state_.store(kSleeping, std::memory_order_relaxed);
        arena->Leave(job);
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

  std::uint64_t NewNumber() { return last_number_.fetch_add(1, std::memory_order_relaxed) + 1; }

  // Before others come to the job.
  void Show(Job* job) {
    job->PutOn(&board_);
    if (job->notice() != nullptr) {
      TellNews();
    }
  }

  // Waits until `count` threads have left the job.
  void Await(const Job& job, std::size_t count) {
    int& depth = ThisPlace().depth;
    sleepers_.fetch_add(1, std::memory_order_relaxed);
    while (true) {
      const int news = news_.load(std::memory_order_relaxed);
      if (job.IsLeftBy(count)) {
        break;
      }
      if (Job* const other = depth < kMaxDepth ? Join() : nullptr; other != nullptr) {
        ++depth;
        other->RunFree();
        --depth;
        Leave(other);
      } else {
        SleepWhile(news_, news, &kLongestSleep);
      }
    }
    sleepers_.fetch_sub(1, std::memory_order_relaxed);
  }
  void Leave(Job* job) {
    job->Leave();
    TellNews();
  }
  // Wakes those that wait: there is a new job, or a thread has left one.
  void TellNews() {
    news_.fetch_add(1, std::memory_order_relaxed);
    if (sleepers_.load(std::memory_order_relaxed) > 0) {
      WakeAll(news_);
    }
  }

  // Joins the newest job on the board that has free chunks for the calling thread. Null if there is
  // none.
  Job* Join() {
    const Place& place = ThisPlace();
    if (place.arena != this || IsForked().load(std::memory_order_relaxed)) {
      return nullptr;
    }
    for (Notice* notice = NewestNotice(place.region); notice != nullptr;
         notice = NewestNotice(place.region)) {
      Job* const job = notice->Join();
      if (job == nullptr) {
        continue;
      }
      if (place.region == 0 || place.region == job->region()) {
        return job;
      }
      Leave(job);  // the notice has got another job since
    }
    return nullptr;
  }
  // Null if there is none. Orders nothing.
  Notice* NewestNotice(std::uint64_t region) {
    Notice* newest = nullptr;
    std::uint64_t newest_number = 0;
    for (Notice& notice : board_) {
      const std::uint64_t number = notice.number.load(std::memory_order_relaxed);
      if ((notice.state.load(std::memory_order_relaxed) & Notice::kOpen) != 0 &&
          notice.free_chunks.load(std::memory_order_relaxed) > 0 && number > newest_number &&
          (region == 0 || notice.region.load(std::memory_order_relaxed) == region)) {
        newest = &notice;
        newest_number = number;
      }
    }
    return newest;
  }

  std::vector<Observer*> Observers() {
    if (!has_observers_.load(std::memory_order_relaxed)) {
      return {};  // without the lock, which would order the threads
    }
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
  Board board_;
  std::atomic<std::uint64_t> last_number_{0};
  std::atomic<int> news_{0};  // a count that may wrap
  std::atomic<int> sleepers_{0};
  std::mutex observers_mutex_;
  std::vector<Observer*> observers_;
  std::atomic<bool> has_observers_{false};
};

}  // namespace inside
}  // namespace stand_in
}  // namespace tbb

namespace oneapi {
namespace tbb = ::tbb;
}

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ARENA_THREADS_H_
