#include "core/base/random.h"

#include <array>
#include <cmath>
#include <set>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

// Source: the sequence of SplitMix64 from state 0, whose n-th value is Mix64(n * golden gamma).
TEST(RandomTest, MixMatchesPublishedSplitMix64) {
  constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15u;
  EXPECT_EQ(Mix64(0), 0xe220a8397b1dcdafu);
  EXPECT_EQ(Mix64(kGamma), 0x6e789e6aa1b965f4u);
  EXPECT_EQ(Mix64(2 * kGamma), 0x06c45d188009454fu);
}

TEST(RandomTest, ValuesOfASeedNeverChange) {
  // Pictures and shards depend on them. Constant expressions: computed by the compiler as by the
  // processor.
  static_assert(RandomBits(1, 0) == Mix64(Mix64(1)));
  EXPECT_NE(RandomBits(1, 0), RandomBits(2, 0));
  EXPECT_NE(RandomBits(1, 0), RandomBits(1, 1));
}

TEST(RandomTest, UnitValuesAreUniformInEveryTenth) {
  for (const std::uint64_t seed : {0u, 1u, 12345u}) {
    std::array<int, 10> counts{};
    double previous = 0.5;
    double covariance = 0;
    for (std::uint64_t i = 0; i < 100000; ++i) {
      const double value = RandomUnit(seed, i);
      ASSERT_GE(value, 0.0);
      ASSERT_LT(value, 1.0);
      ++counts[static_cast<std::size_t>(value * 10)];
      covariance += (value - 0.5) * (previous - 0.5);
      previous = value;
    }
    for (const int count : counts) {
      EXPECT_NEAR(count, 10000, 6 * std::sqrt(9000.0));
    }
    // Its standard deviation is sqrt(n) / 12.
    EXPECT_NEAR(covariance, 0, 6 * std::sqrt(100000.0) / 12);
  }
}

TEST(RandomTest, SmallSeedsAndCountersDoNotCollide) {
  std::set<std::uint64_t> values;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    for (std::uint64_t counter = 0; counter < 100; ++counter) {
      values.insert(RandomBits(seed, counter));
    }
  }
  EXPECT_EQ(values.size(), 10000u);
}

}  // namespace
}  // namespace isoscope::base
