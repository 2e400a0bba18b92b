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

// Whoever destroys one with tasks has to wait() before: it ends the program otherwise.
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

  // A sleeping thread of the arena begins at once. Otherwise the task is done in wait().
  template <typename Function>
  void run(Function&& function) {
    // std::function copies what it holds.
    auto owned = std::make_shared<std::decay_t<Function>>(std::forward<Function>(function));
    auto job = std::make_shared<inside::Job>(
        1, [owned](std::size_t /*chunk*/) { (*owned)(); }, nullptr);
    job->SetParticipants(1);
    const bool is_handed = inside::Arena::Current().Hand(job);
    const std::lock_guard<std::mutex> lock(mutex_);
    queued_.push_back({std::move(job), is_handed});
  }

  // Throws what the first task threw.
  task_group_status wait() {
    std::exception_ptr exception;
    while (true) {
      Task task;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (queued_.empty()) {
          break;
        }
        // Those of other threads last, so that nothing orders them and the caller's.
        auto next = std::find_if(queued_.begin(), queued_.end(),
                                 [](const Task& queued) { return !queued.is_handed; });
        next = next == queued_.end() ? queued_.begin() : next;
        task = std::move(*next);
        queued_.erase(next);
      }
      if (task.is_handed) {
        task.job->Await(1);
      } else {
        const inside::Arena::Enter inside(&inside::Arena::Current());
        task.job->Work(0);
      }
      try {
        task.job->Rethrow();
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
  struct Task {
    std::shared_ptr<inside::Job> job;
    bool is_handed = false;
  };

  std::mutex mutex_;
  std::deque<Task> queued_;
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_GROUP_H_
