#include "core/base/executor.h"

#include <utility>

#include "core/base/check.h"

namespace isoscope::base {

Executor::Executor(std::size_t thread_count, std::size_t max_queued) : max_queued_(max_queued) {
  ISOSCOPE_CHECK_GE(thread_count, 1u);
  threads_.reserve(thread_count);
  for (std::size_t i = 0; i < thread_count; ++i) {
    threads_.emplace_back([this] { Run(); });
  }
}

Executor::~Executor() {
  {
    MutexLock lock(&mutex_);
    stopping_ = true;
    changed_.SignalAll();
  }
  for (std::thread& thread : threads_) {
    thread.join();
  }
}

bool Executor::TrySchedule(Task task) {
  {
    MutexLock lock(&mutex_);
    if (stopping_ || queue_.size() >= max_queued_) {
      return false;
    }
    queue_.push_back(std::move(task));
  }
  changed_.Signal();  // without the mutex, which the woken thread needs at once
  return true;
}

void Executor::Run() {
  while (true) {
    Task task;
    {
      MutexLock lock(&mutex_);
      changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return stopping_ || !queue_.empty();
      });
      if (queue_.empty()) {
        return;
      }
      task = std::move(queue_.front());
      queue_.pop_front();
    }
    std::move(task)();
  }
}

ExecutorShare::~ExecutorShare() {
  const MutexLock lock(&mutex_);
  ended_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return task_count_ == 0; });
}

bool ExecutorShare::TrySchedule(Executor::Task task) {
  {
    const MutexLock lock(&mutex_);
    if (task_count_ >= max_tasks_) {
      return false;
    }
    ++task_count_;
  }
  const bool is_scheduled = executor_->TrySchedule([this, task = std::move(task)]() mutable {
    {
      Executor::Task running = std::move(task);
      std::move(running)();
    }  // what the task holds is gone before it counts as ended
    NoteEnd();
  });
  if (!is_scheduled) {
    NoteEnd();
  }
  return is_scheduled;
}

void ExecutorShare::NoteEnd() {
  const MutexLock lock(&mutex_);
  --task_count_;
  ended_.SignalAll();  // with the mutex: the owner may be gone right after
}

}  // namespace isoscope::base
