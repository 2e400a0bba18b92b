#include "core/math/exact_sum.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::math {
namespace {

double SumOf(const std::vector<double>& values) {
  ExactSum sum;
  for (const double value : values) {
    sum.Add(value);
  }
  return sum.Value();
}

TEST(ExactSumTest, NothingIsLostBetweenTheLargestAndTheSmallestDouble) {
  const double max = std::numeric_limits<double>::max();
  const double least = std::numeric_limits<double>::denorm_min();
  EXPECT_EQ(SumOf({}), 0);
  EXPECT_EQ(SumOf({1.5}), 1.5);
  EXPECT_EQ(SumOf({-1.5}), -1.5);
  EXPECT_EQ(SumOf({max, 1, -max}), 1);
  EXPECT_EQ(SumOf({max, least, -max}), least);
  EXPECT_EQ(SumOf({max, max, -max}), max);
  EXPECT_EQ(SumOf({-max, -least, max}), -least);
  EXPECT_EQ(SumOf({0x1.fffffffffffffp-1022, -0x1p-1022}), 0x1.ffffffffffffep-1023);
  EXPECT_TRUE(std::isinf(SumOf({max, max})));
  EXPECT_EQ(SumOf({3, -3}), 0);
  EXPECT_FALSE(std::signbit(SumOf({3, -3})));
}

// 1 + 2^-53 lies in the middle of two doubles.
TEST(ExactSumTest, ASumIsRoundedOnceAndTiesGoToEven) {
  EXPECT_EQ(SumOf({1, 0x1p-53}), 1);
  EXPECT_EQ(SumOf({1, 0x1p-53, 0x1p-1000}), 1 + 0x1p-52);
  EXPECT_EQ(SumOf({1, 0x1p-52, 0x1p-53}), 1 + 0x1p-51);
  EXPECT_EQ(SumOf({-1, -0x1p-53, -0x1p-1000}), -1 - 0x1p-52);
  EXPECT_EQ(SumOf({1, 0x1p-53, -0x1p-1000}), 1);
  EXPECT_EQ(SumOf({0x1p-1000, 0x1p-53, 1}), 1 + 0x1p-52);
}

TEST(ExactSumTest, NoOrderShowsInASum) {
  std::vector<double> values;
  std::int64_t whole = 0;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    // Whole numbers of very different sizes, whose sum int64 holds.
    const double size = std::ldexp(1.0, static_cast<int>(i % 50));
    const double value = std::floor((base::RandomUnit(1, i) - 0.5) * size);
    values.push_back(std::ldexp(value, -500));
    whole += static_cast<std::int64_t>(value);
  }
  const double sum = SumOf(values);
  EXPECT_EQ(sum, std::ldexp(static_cast<double>(whole), -500));
  std::sort(values.begin(), values.end());
  EXPECT_EQ(SumOf(values), sum);
  std::reverse(values.begin(), values.end());
  EXPECT_EQ(SumOf(values), sum);
  ExactSum first;
  ExactSum second;
  for (std::size_t i = 0; i < values.size(); ++i) {
    (i % 3 == 0 ? first : second).Add(values[i]);
  }
  ExactSum both = second;
  both.Add(first);
  EXPECT_EQ(both.Value(), sum);
}

TEST(ExactSumTest, ANaNOrAnInfinityMakesTheSumNaN) {
  EXPECT_TRUE(std::isnan(SumOf({1, std::numeric_limits<double>::quiet_NaN(), 2})));
  EXPECT_TRUE(std::isnan(SumOf({1, std::numeric_limits<double>::infinity()})));
  ExactSum broken;
  broken.Add(-std::numeric_limits<double>::infinity());
  ExactSum sum;
  sum.Add(1);
  sum.Add(broken);
  EXPECT_TRUE(std::isnan(sum.Value()));
  EXPECT_TRUE(std::isnan(ExactSum::Decode(sum.Encode())->Value()));
}

TEST(ExactSumTest, BytesKeepTheSum) {
  ExactSum forth;
  ExactSum back;
  const std::vector<double> values = {1e300, -0.1, 3e-310, 12345.678, -1e-200};
  for (std::size_t i = 0; i < values.size(); ++i) {
    forth.Add(values[i]);
    back.Add(values[values.size() - 1 - i]);
  }
  EXPECT_EQ(forth.Encode(), back.Encode());
  const ExactSum read = ExactSum::Decode(forth.Encode()).value();
  EXPECT_EQ(read.Value(), forth.Value());
  ExactSum rest = read;
  rest.Add(-1e300);
  EXPECT_EQ(rest.Value(), SumOf({-0.1, 3e-310, 12345.678, -1e-200}));
}

TEST(ExactSumTest, BytesThatAreNoSumAreAnError) {
  EXPECT_FALSE(ExactSum::Decode("").ok());
  ExactSum sum;
  sum.Add(1);
  std::string bytes = sum.Encode();
  EXPECT_FALSE(ExactSum::Decode(bytes + "x").ok());
  EXPECT_FALSE(ExactSum::Decode(absl::string_view(bytes).substr(1)).ok());
  bytes[1 + 7] = 1;  // a digit above 32 bits
  EXPECT_EQ(ExactSum::Decode(bytes).status().message(),
            "exact sum with digit 72057594037927936 at 0: out of range");
  bytes[1 + 7] = '\xff';
  EXPECT_FALSE(ExactSum::Decode(bytes).ok());
}

// The last digit has the sign. Beyond 2^62 a further addition might overflow it.
TEST(ExactSumTest, TheLastDigitIsBoundedOnBothSides) {
  const std::string zero = ExactSum().Encode();
  const auto with_last_byte = [&zero](char byte) {
    std::string bytes = zero;
    bytes.back() = byte;
    return ExactSum::Decode(bytes).status();
  };
  EXPECT_TRUE(with_last_byte('\x40').ok());
  EXPECT_FALSE(with_last_byte('\x41').ok());
  EXPECT_TRUE(with_last_byte('\xc0').ok());
  EXPECT_FALSE(with_last_byte('\xbf').ok());
}

}  // namespace
}  // namespace isoscope::math
