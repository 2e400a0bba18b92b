#include "tests/support/draws.h"

#include <cstdlib>
#include <map>
#include <set>
#include <sstream>

#include "gtest/gtest.h"

namespace isoscope::testing {
namespace {

TEST(DrawsTest, EachThreadCountAndEachMagnitudeOfLimitsHasItsTurn) {
  Dice dice(7);
  std::map<int, int> threads;
  int none = 0;
  int tight = 0;
  int alone = 0;
  for (int i = 0; i < 1000; ++i) {
    const Limits limits = DrawLimits(&dice);
    ++threads[limits.thread_count];
    EXPECT_GE(limits.memory_limit_bytes, kLeastMemoryLimitBytes);
    EXPECT_LE(limits.memory_limit_bytes, Limits::kNoMemoryLimit);
    none += limits.memory_limit_bytes == Limits::kNoMemoryLimit ? 1 : 0;
    tight += limits.kept_mesh_bytes() < (1 << 12) ? 1 : 0;
    alone += limits.one_thread_a_step ? 1 : 0;
  }
  ASSERT_EQ(threads.size(), kThreadCounts.size());
  for (const int count : kThreadCounts) {
    EXPECT_GT(threads[count], 100) << count;
  }
  EXPECT_GT(none, 150);
  EXPECT_GT(tight, 100);
  EXPECT_GT(alone, 400);
  EXPECT_LT(alone, 600);
}

TEST(DrawsTest, SeedsFollowFromTheTestTheSaltAndTheEnvironment) {
  // NOLINTBEGIN(concurrency-mt-unsafe): one thread
  unsetenv("ISOSCOPE_DRAW_SEED");
  std::set<std::uint64_t> seeds = {DrawSeed(), DrawSeed("a"), DrawSeed("b")};
  EXPECT_EQ(seeds.size(), 3U);
  EXPECT_TRUE(seeds.contains(DrawSeed("a")));
  setenv("ISOSCOPE_DRAW_SEED", "2", 1);
  seeds.insert({DrawSeed(), DrawSeed("a")});
  EXPECT_EQ(seeds.size(), 5U);
  unsetenv("ISOSCOPE_DRAW_SEED");
  // NOLINTEND(concurrency-mt-unsafe)
}

TEST(DrawsTest, LimitsSayWhatTheyAre) {
  std::ostringstream text;
  text << Limits{.thread_count = 1} << "; "
       << Limits{.thread_count = 3, .memory_limit_bytes = 4096, .one_thread_a_step = true};
  EXPECT_EQ(text.str(),
            "1 thread, no memory limit; 3 threads, one a step, a memory limit of 4096 bytes");
}

}  // namespace
}  // namespace isoscope::testing
