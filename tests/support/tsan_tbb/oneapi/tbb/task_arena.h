// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_ARENA_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_ARENA_H_

#include <memory>
#include <mutex>

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {

class task_arena {
 public:
  static constexpr int automatic = -1;

  explicit task_arena(int concurrency = automatic) : concurrency_(concurrency) {}
  task_arena(const task_arena&) = delete;
  task_arena& operator=(const task_arena&) = delete;

  void initialize() { Get(); }
  void initialize(int concurrency) {
    concurrency_ = concurrency;
    Get();
  }
  [[nodiscard]] int max_concurrency() const {
    return concurrency_ == automatic ? inside::DefaultConcurrency() : concurrency_;
  }
  template <typename Function>
  auto execute(Function&& function) -> decltype(function()) {
    const inside::Arena::Enter inside(&Get());
    const inside::InRegion none(0);
    return function();
  }

  // Inside of the stand-in.
  inside::Arena& Get() {
    std::call_once(*made_, [this] { arena_ = std::make_unique<inside::Arena>(max_concurrency()); });
    return *arena_;
  }

 private:
  int concurrency_;
  std::unique_ptr<std::once_flag> made_ = std::make_unique<std::once_flag>();
  std::unique_ptr<inside::Arena> arena_;
};

namespace this_task_arena {
inline constexpr int not_initialized = -2;

inline int current_thread_index() {
  return inside::ThisPlace().arena == nullptr ? not_initialized : inside::ThisPlace().slot;
}
inline int max_concurrency() { return inside::Arena::Current().concurrency(); }
template <typename Function>
auto isolate(Function&& function) -> decltype(function()) {
  const inside::InRegion region(inside::InRegion::New());
  return function();
}
}  // namespace this_task_arena

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_ARENA_H_
