#include "core/volume/min_max.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::volume {
namespace {

template <typename T>
volume::ScalarSpan SpanOf(const std::vector<T>& samples, std::size_t row_length) {
  MinMax<T> min_max;
  for (std::size_t i = 0; i < samples.size(); i += row_length) {
    min_max.AddRow(reinterpret_cast<const char*>(samples.data() + i),
                   std::min(row_length, samples.size() - i));
  }
  return min_max.Get();
}

TEST(MinMaxTest, FindsExtremesAtEveryPlaceOfRowsOfEveryLength) {
  for (std::size_t length = 1; length < 40; ++length) {
    for (std::size_t place = 0; place < length; ++place) {
      // The greatest lies opposite to the least, unless that is the same place.
      const std::size_t opposite = length - 1 - place;
      std::vector<std::int16_t> samples(length, 5);
      samples[opposite] = 900;
      samples[place] = -300;
      const double greatest = place != opposite ? 900 : length > 1 ? 5 : -300;
      EXPECT_EQ(SpanOf(samples, length), (volume::ScalarSpan{-300, greatest}))
          << length << ", " << place;
      EXPECT_EQ(SpanOf(samples, 7), SpanOf(samples, length)) << length << ", " << place;
    }
  }
}

TEST(MinMaxTest, ExtremesOfTheTypeCount) {
  EXPECT_EQ(SpanOf<std::uint32_t>({0xffffffffU, 0xffffffffU}, 2),
            (volume::ScalarSpan{4294967295.0, 4294967295.0}));
  EXPECT_EQ(SpanOf<std::int8_t>({-128}, 1), (volume::ScalarSpan{-128, -128}));
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(SpanOf<double>({kInf, kInf}, 2), (volume::ScalarSpan{kInf, kInf}));
}

TEST(MinMaxTest, NothingAndNothingButNanIsAnEmptySpan) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(SpanOf<float>({}, 1), volume::ScalarSpan{});
  EXPECT_EQ(SpanOf<float>(std::vector<float>(50, kNan), 9), volume::ScalarSpan{});
}

TEST(MinMaxTest, ZerosOfBothSignsHaveOneSpan) {
  for (const std::vector<float>& zeros :
       {std::vector<float>{0.0F, -0.0F}, {-0.0F, 0.0F}, {-0.0F, -0.0F}}) {
    const volume::ScalarSpan span = SpanOf(zeros, 2);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(span.min), 0U);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(span.max), 0U);
  }
}

}  // namespace
}  // namespace isoscope::volume
