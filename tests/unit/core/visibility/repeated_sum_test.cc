// The sum by jumps is compared with additions one by one, bit for bit: random numbers, ties between
// neighbouring doubles, sums that cross binades, that no longer change, and that are not finite.

#include "core/visibility/repeated_sum.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::visibility {
namespace {

double OneByOne(double t, double step, std::int64_t count) {
  for (std::int64_t i = 0; i < count; ++i) {
    t += step;
  }
  return t;
}

void ExpectEqual(double t, double step, std::int64_t count) {
  const double expected = OneByOne(t, step, count);
  const double actual = RepeatedSum(t, step, count);
  EXPECT_EQ(std::bit_cast<std::uint64_t>(actual), std::bit_cast<std::uint64_t>(expected))
      << t << " + " << count << " * " << step;
}

TEST(RepeatedSumTest, EqualsAdditionsOneByOne) {
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const double t =
        base::RandomUnit(1, 4 * i) * std::exp2(40 * base::RandomUnit(1, 4 * i + 1) - 20);
    const double step = std::exp2(60 * base::RandomUnit(1, 4 * i + 2) - 50);
    ExpectEqual(t, step, static_cast<std::int64_t>(1200 * base::RandomUnit(1, 4 * i + 3)));
  }
}

TEST(RepeatedSumTest, TiesAreRoundedAsTheyComeUp) {
  // Steps of (m + 1/2) units in the last place, from odd and even multiples, across a binade.
  const double unit = std::numeric_limits<double>::epsilon();
  for (const double start : {1.0, 1.0 + unit, 1.0 + 2 * unit, 1.0 + 3 * unit, 2.0 - 5 * unit}) {
    for (const double halves : {1.0, 2.0, 3.0, 5.0, 7.0, 1001.0, 0x1p44 + 1, 0x1p44 + 3}) {
      for (const std::int64_t count : {0, 1, 2, 3, 4, 5, 6, 7, 100, 1001}) {
        ExpectEqual(start, halves * unit / 2, count);
        ExpectEqual(start / 2, halves * unit / 2, count);
      }
    }
  }
}

TEST(RepeatedSumTest, NumbersAtTheEndsOfTheScaleKeepTheirSums) {
  const double infinity = std::numeric_limits<double>::infinity();
  const double tiny = std::numeric_limits<double>::denorm_min();
  const double most = std::numeric_limits<double>::max();
  for (const double t :
       {0.0, tiny, 5 * tiny, std::numeric_limits<double>::min(), -3.5, most / 3, most, infinity}) {
    for (const double step : {0.0, tiny, 1.0, most / 7, infinity}) {
      for (const std::int64_t count : {0, 1, 3, 4, 9, 1000}) {
        ExpectEqual(t, step, count);
      }
    }
  }
}

TEST(RepeatedSumTest, AStepTooSmallToCountChangesNothing) {
  EXPECT_EQ(RepeatedSum(1.0, 0x1p-54, 1'000'000'000'000), 1.0);
  EXPECT_EQ(RepeatedSum(1.0, 1.0, (std::int64_t{1} << 53) + 5), 0x1p53);
}

}  // namespace
}  // namespace isoscope::visibility
