// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_INVOKE_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_INVOKE_H_

#include <cstddef>
#include <functional>
#include <vector>

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {

template <typename... Functions>
void parallel_invoke(const Functions&... functions) {
  const std::vector<std::function<void()>> all = {std::function<void()>(std::cref(functions))...};
  inside::Arena::Current().Run(all.size(), [&](std::size_t i) { all[i](); });
}

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_INVOKE_H_
