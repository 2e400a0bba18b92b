// A fixed number of threads behind a bounded queue. It refuses work instead of growing: gRPC
// reactions hand their work to one and return at once.

#ifndef ISOSCOPE_CORE_BASE_EXECUTOR_H_
#define ISOSCOPE_CORE_BASE_EXECUTOR_H_

#include <cstddef>
#include <deque>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/any_invocable.h"

#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. The destructor runs the queued tasks, then joins the threads.
class Executor {
 public:
  using Task = absl::AnyInvocable<void() &&>;

  // REQUIRES: thread_count >= 1. At most `max_queued` tasks wait beside those that run.
  Executor(std::size_t thread_count, std::size_t max_queued);
  ~Executor();

  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;

  // Queues `task`. Returns false, and drops it unrun, when the queue is full or the executor is
  // being destroyed.
  [[nodiscard]] bool TrySchedule(Task task);

 private:
  void Run();

  const std::size_t max_queued_;
  Mutex mutex_;
  CondVar changed_;  // a task was queued, or the executor stops
  std::deque<Task> queue_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

// The tasks of one owner on an executor that several share. Thread-safe. The destructor waits until
// the owner's tasks have run.
class ExecutorShare {
 public:
  // At most `max_tasks` of the owner run or wait at a time. The executor refuses nothing itself:
  // REQUIRES: it has room for the tasks of all its owners.
  ExecutorShare(std::shared_ptr<Executor> executor, std::size_t max_tasks)
      : executor_(std::move(executor)), max_tasks_(max_tasks) {}
  ~ExecutorShare();

  ExecutorShare(const ExecutorShare&) = delete;
  ExecutorShare& operator=(const ExecutorShare&) = delete;

  // As Executor::TrySchedule; refuses also when the owner has `max_tasks`.
  [[nodiscard]] bool TrySchedule(Executor::Task task) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void NoteEnd() ABSL_LOCKS_EXCLUDED(mutex_);

  const std::shared_ptr<Executor> executor_;
  const std::size_t max_tasks_;
  Mutex mutex_;
  CondVar ended_;
  std::size_t task_count_ ABSL_GUARDED_BY(mutex_) = 0;  // that run or wait
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_EXECUTOR_H_
