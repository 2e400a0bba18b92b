// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_SCHEDULER_OBSERVER_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_SCHEDULER_OBSERVER_H_

#include "oneapi/tbb/arena_threads.h"
#include "oneapi/tbb/task_arena.h"

namespace tbb {
inline namespace stand_in {

// No thread may work in the arena when it is destroyed.
class task_scheduler_observer : public inside::Observer {
 public:
  explicit task_scheduler_observer(task_arena& arena) : arena_(arena.Get()) {}
  ~task_scheduler_observer() override { observe(false); }
  task_scheduler_observer(const task_scheduler_observer&) = delete;
  task_scheduler_observer& operator=(const task_scheduler_observer&) = delete;

  void observe(bool state = true) {
    if (state && !observes_) {
      arena_.AddObserver(this);
    } else if (!state && observes_) {
      arena_.RemoveObserver(this);
    }
    observes_ = state;
  }

 private:
  inside::Arena& arena_;
  bool observes_ = false;
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_TASK_SCHEDULER_OBSERVER_H_
