// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_GROUP_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_GROUP_H_

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <type_traits>
#include <utility>

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {

// Cancels the loop that it is given to, but none inside that.
class task_group_context {
 public:
  enum kind_type { isolated, bound };

  explicit task_group_context(kind_type /*kind*/ = bound) {}
  bool cancel_group_execution() { return !cancelled_.exchange(true); }
  [[nodiscard]] bool is_group_execution_cancelled() const { return cancelled_; }

  // Inside of the stand-in.
  [[nodiscard]] const std::atomic<bool>* flag() const { return &cancelled_; }

 private:
  std::atomic<bool> cancelled_{false};
};

enum task_group_status { not_complete, complete, canceled };

// Call wait() before destroying a group with tasks: otherwise the program ends.
class task_group {
 public:
  task_group() = default;
  ~task_group() {
    if (!queued_.empty()) {
      std::terminate();
    }
  }
  task_group(const task_group&) = delete;
  task_group& operator=(const task_group&) = delete;

  // A sleeping thread of the arena begins at once. Otherwise the first that waits for something in
  // the arena does the task.
  template <typename Function>
  void run(Function&& function) {
    // std::function copies what it holds.
    auto owned = std::make_shared<std::decay_t<Function>>(std::forward<Function>(function));
    inside::Arena& arena = inside::Arena::Current();
    inside::Arena::Task task = arena.Start([owned](std::size_t /*chunk*/) { (*owned)(); });
    const std::lock_guard<std::mutex> lock(mutex_);
    queued_.push_back({&arena, std::move(task)});
  }

  // Throws what the first task threw.
  task_group_status wait() {
    std::exception_ptr exception;
    const inside::Arena::Enter inside(&inside::Arena::Current());
    while (true) {
      Queued next;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (queued_.empty()) {
          break;
        }
        // Those of other threads last, so that nothing orders them and the caller's.
        auto at = std::find_if(queued_.begin(), queued_.end(),
                               [](const Queued& queued) { return queued.task.job->HasFree(); });
        at = at == queued_.end() ? queued_.begin() : at;
        next = std::move(*at);
        queued_.erase(at);
      }
      try {
        next.arena->Finish(next.task.job.get(), next.task.participants);
      } catch (...) {
        exception = exception == nullptr ? std::current_exception() : exception;
      }
    }
    if (exception != nullptr) {
      std::rethrow_exception(exception);
    }
    return complete;
  }

 private:
  struct Queued {
    inside::Arena* arena = nullptr;
    inside::Arena::Task task;
  };

  std::mutex mutex_;
  std::deque<Queued> queued_;
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_GROUP_H_
