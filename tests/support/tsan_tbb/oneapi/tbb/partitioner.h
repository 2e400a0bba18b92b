// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARTITIONER_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARTITIONER_H_

namespace tbb {
inline namespace stand_in {

struct split {};
class simple_partitioner {};
class auto_partitioner {};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARTITIONER_H_
