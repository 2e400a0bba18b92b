#include "tests/support/only_arena.h"

#include <set>
#include <thread>

#include "gtest/gtest.h"
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/mutex.h"
#include "tests/support/status_matchers.h"

namespace isoscope::testing {
namespace {

// The next one has as many threads as it asks for, whatever the last one had.
TEST(OnlyArenaTest, HasItsThreadsAfterOneOfAnyOtherCount) {
  for (const int count : {1, 32, 2, 8, 1, 3, 2, 32}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, MakeOnlyArena(count));
    EXPECT_EQ(arena->max_concurrency(), count);
    EXPECT_EQ(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism),
              static_cast<std::size_t>(count));
    // No more than that work.
    std::set<std::thread::id> threads;
    base::Mutex mutex;
    base::RunIn(arena.get(), [&] {
      tbb::parallel_for(0, 1000, [&](int /*i*/) {
        const base::MutexLock lock(&mutex);
        threads.insert(std::this_thread::get_id());
      });
    });
    EXPECT_LE(threads.size(), static_cast<std::size_t>(count));
  }
}

TEST(OnlyArenaDeathTest, TwoAtATimeEndTheProcess) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, MakeOnlyArena(1));
  EXPECT_DEATH(MakeOnlyArena(2).IgnoreError(), "alive_count");
}

}  // namespace
}  // namespace isoscope::testing
