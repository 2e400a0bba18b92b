#include "core/base/monotonic_time.h"

#include <type_traits>

#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "tests/support/date_functions.h"

namespace isoscope::base {
namespace {

static_assert(!std::is_convertible_v<absl::Time, MonotonicTime> &&
              !std::is_convertible_v<MonotonicTime, absl::Time> &&
              !std::is_constructible_v<MonotonicTime, absl::Time> &&
              !std::is_constructible_v<MonotonicTime, absl::Duration>);

TEST(MonotonicTimeTest, IntervalsAreSumsAndDifferences) {
  const MonotonicTime begin = MonotonicNow();
  MonotonicTime end = begin + absl::Milliseconds(1500);
  EXPECT_EQ(end - begin, absl::Milliseconds(1500));
  EXPECT_EQ(end - absl::Seconds(1), absl::Milliseconds(500) + begin);
  end -= absl::Seconds(2);
  EXPECT_EQ(end - begin, -absl::Milliseconds(500));
  end += absl::Milliseconds(500);
  EXPECT_EQ(end, begin);
  EXPECT_EQ(MonotonicTime() + absl::Seconds(3), MonotonicTime() + absl::Milliseconds(3000));
}

TEST(MonotonicTimeTest, EarlierIsLess) {
  const MonotonicTime begin = MonotonicNow();
  const MonotonicTime end = begin + absl::Nanoseconds(1);
  EXPECT_LT(begin, end);
  EXPECT_GT(end, begin);
  EXPECT_LE(begin, begin);
  EXPECT_NE(begin, end);
  EXPECT_LT(MonotonicTime(), begin);
}

TEST(MonotonicTimeTest, InfiniteMomentsStayInfinite) {
  const MonotonicTime future = MonotonicTime::InfiniteFuture();
  const MonotonicTime past = MonotonicTime::InfinitePast();
  EXPECT_LT(past, MonotonicNow());
  EXPECT_LT(MonotonicNow(), future);
  EXPECT_EQ(future - absl::Hours(1), future);
  EXPECT_EQ(past + absl::Hours(1), past);
  EXPECT_EQ(MonotonicNow() + absl::InfiniteDuration(), future);
  EXPECT_EQ(future - MonotonicNow(), absl::InfiniteDuration());
  EXPECT_EQ(MonotonicNow() - past, absl::InfiniteDuration());
}

TEST(MonotonicTimeTest, NowGoesOnThoughTheDateJumps) {
  const MonotonicTime before = MonotonicNow();
  testing::SetDateOffset(-3600);
  const MonotonicTime back = MonotonicNow();
  testing::SetDateOffset(3600);
  const MonotonicTime forth = MonotonicNow();
  testing::SetDateOffset(0);
  EXPECT_LE(before, back);
  EXPECT_LE(back, forth);
  EXPECT_LT(forth - before, absl::Minutes(30));
}

TEST(MonotonicTimeTest, ItIsAMomentOfTheSteadyClock) {
  const auto before = std::chrono::steady_clock::now();
  const MonotonicTime now = MonotonicNow();
  EXPECT_LE(before, now.ToChrono());
  EXPECT_LE(now.ToChrono(), std::chrono::steady_clock::now());
}

}  // namespace
}  // namespace isoscope::base
