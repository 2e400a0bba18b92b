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

}  // namespace isoscope::base
