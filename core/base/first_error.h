// The first error of tasks that run in parallel.

#ifndef ISOSCOPE_CORE_BASE_FIRST_ERROR_H_
#define ISOSCOPE_CORE_BASE_FIRST_ERROR_H_

#include <atomic>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"

#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe.
class FirstError {
 public:
  // Cheap: for tasks that stop once another has failed.
  [[nodiscard]] bool has_error() const { return has_error_.load(std::memory_order_relaxed); }
  // Keeps `status` if it is the first error.
  void Set(absl::Status status) {
    if (status.ok()) {
      return;
    }
    const MutexLock lock(&mutex_);
    if (status_.ok()) {
      status_ = std::move(status);
      has_error_.store(true, std::memory_order_relaxed);
    }
  }
  [[nodiscard]] absl::Status status() const {
    const MutexLock lock(&mutex_);
    return status_;
  }

 private:
  std::atomic<bool> has_error_{false};
  mutable Mutex mutex_;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_FIRST_ERROR_H_
