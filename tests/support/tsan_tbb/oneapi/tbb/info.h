// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_INFO_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_INFO_H_

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {
namespace info {
inline int default_concurrency() { return inside::DefaultConcurrency(); }
}  // namespace info
}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_INFO_H_
