// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_GLOBAL_CONTROL_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_GLOBAL_CONTROL_H_

#include <cstddef>
#include <mutex>

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {

class global_control {
 public:
  enum parameter { max_allowed_parallelism };

  global_control(parameter /*one*/, std::size_t value) : value_(value) {
    inside::AllowedThreads& allowed = inside::AllowedThreads::Get();
    const std::lock_guard<std::mutex> lock(allowed.mutex);
    allowed.values.insert(value_);
    allowed.Update();
  }
  ~global_control() {
    inside::AllowedThreads& allowed = inside::AllowedThreads::Get();
    const std::lock_guard<std::mutex> lock(allowed.mutex);
    allowed.values.erase(allowed.values.find(value_));
    allowed.Update();
  }
  global_control(const global_control&) = delete;
  global_control& operator=(const global_control&) = delete;

 private:
  const std::size_t value_;
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_GLOBAL_CONTROL_H_
