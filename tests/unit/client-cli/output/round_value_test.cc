#include "client-cli/output/round_value.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

TEST(RoundedValueTest, HasTheDigitsThatTheRangeAsksFor) {
  EXPECT_EQ(RoundedValue(59.470588, 0, 255), 59.5);
  EXPECT_EQ(RoundedValue(30.000000000004, 0, 255), 30);
  EXPECT_EQ(RoundedValue(112.3456, -1024, 3071), 112);
  EXPECT_EQ(RoundedValue(0.50196078, 0, 1), 0.502);
  EXPECT_EQ(RoundedValue(-0.000123456, -0.001, 0.001), -0.000123);
  EXPECT_EQ(RoundedValue(301.57731, 293.15, 330.02), 301.58);
  EXPECT_EQ(RoundedValue(1'000'000.2512, 1'000'000, 1'000'000.5), 1'000'000.2512);
  EXPECT_EQ(RoundedValue(1'000'000.25123, 1'000'000, 1'000'000.5), 1'000'000.2512);
}

TEST(RoundedValueTest, StaysInsideOfTheRange) {
  for (const double value : {0.00001234, 254.9999, 1e-300}) {
    const double rounded = RoundedValue(value, 0, 255);
    EXPECT_GT(rounded, 0) << value;
    EXPECT_LT(rounded, 255) << value;
    EXPECT_NEAR(rounded, value, 0.02 * std::fmin(value, 255 - value)) << value;
  }
}

TEST(RoundedValueTest, WhatIsNoValueOfTheRangeStays) {
  EXPECT_EQ(RoundedValue(59.470588, 0, 1), 59.470588);
  EXPECT_EQ(RoundedValue(0.123456789, 0.123456789, 1), 0.123456789);
  EXPECT_EQ(RoundedValue(7.77777777, 7, 7), 7.77777777);
  EXPECT_EQ(RoundedValue(0, -1, 1), 0);
  EXPECT_TRUE(std::isnan(RoundedValue(std::nan(""), 0, 1)));
}

TEST(RoundedValueTest, RangesOfAllSizesHaveThem) {
  constexpr double kLargest = std::numeric_limits<double>::max();
  EXPECT_EQ(RoundedValue(3.51234567e307, -kLargest, kLargest), 3.51e307);
  EXPECT_EQ(RoundedValue(0.9, -kLargest, kLargest), 0);
  const double tiny = std::numeric_limits<double>::denorm_min();
  EXPECT_EQ(RoundedValue(2 * tiny, tiny, 3 * tiny), 2 * tiny);
}

}  // namespace
}  // namespace isoscope::cli
