#include "core/picture/sample_window.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::picture {
namespace {

using volume::SampleHistogram;
using volume::ScalarSpan;
using volume::ScalarType;

SampleHistogram Counts(int exponent, std::int64_t first, std::vector<std::int64_t> counts) {
  SampleHistogram samples;
  samples.bins = {
      .exponent = exponent, .first = first, .count = static_cast<std::int64_t>(counts.size())};
  samples.counts = std::move(counts);
  return samples;
}

frame::Surface Of(double isovalue, float opacity = 1) {
  return {.rule = {.isovalue = isovalue}, .opacity = opacity};
}

TEST(LeastSampleTest, IsTheLowestIsovalueOfAnOpaqueSurface) {
  frame::FrameSpec spec;
  spec.surfaces = {Of(75), Of(30), Of(10, 0.5F)};
  EXPECT_EQ(LeastSampleOf(spec), 30);
  spec.surfaces[1].color_by = frame::ColorBy{.opacity_at_min = 0.5F};
  EXPECT_EQ(LeastSampleOf(spec), 75) << "a map makes the other one translucent";
  spec.surfaces = {Of(10, 0.5F)};
  EXPECT_FALSE(LeastSampleOf(spec).has_value());
  spec.surfaces = {Of(75), {.rule = volume::InsideRule::OfLabels({3})}};
  EXPECT_FALSE(LeastSampleOf(spec).has_value()) << "labels may lie below";
}

// Symptom: the window of a CT with air around the head was that of the air.
TEST(SpanOfPercentilesTest, SamplesBelowTheLeastDoNotCount) {
  // 1000 of 0, then 10 each of 20 to 29.
  std::vector<std::int64_t> counts(30, 0);
  counts[0] = 1000;
  std::fill(counts.begin() + 20, counts.end(), 10);
  const SampleHistogram samples = Counts(0, 0, counts);
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kUint8, samples, {2, 98}, std::nullopt),
            (ScalarSpan{0, 27}));
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kUint8, samples, {2, 98}, 10), (ScalarSpan{20, 29}));
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kUint8, samples, {25, 75}, 10), (ScalarSpan{22, 27}));
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kUint8, samples, {0, 100}, 21.5), (ScalarSpan{22, 29}))
      << "21 is below 21.5";
}

TEST(SpanOfPercentilesTest, AllSamplesCountWhereNoneIsThatLarge) {
  const SampleHistogram samples = Counts(0, 5, {1, 2, 1});
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kInt16, samples, {0, 100}, 50), (ScalarSpan{5, 7}));
  for (const SampleHistogram& none : {Counts(0, 0, {}), Counts(0, 3, {0, 0})}) {
    EXPECT_FALSE(SpanOfPercentiles(ScalarType::kInt16, none, {0, 100}, 50).has_value());
    EXPECT_FALSE(SpanOfPercentiles(ScalarType::kInt16, none, {0, 100}, {}).has_value());
  }
}

TEST(SpanOfPercentilesTest, WithinABinOfFloatsSamplesAreSpreadEvenly) {
  // 100 samples in [0, 0.5), 100 in [0.5, 1).
  const SampleHistogram samples = Counts(-1, 0, {100, 100});
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kFloat32, samples, {25, 75}, {}),
            (ScalarSpan{0.25, 0.75}));
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kFloat32, samples, {0, 100}, {}), (ScalarSpan{0, 1}));
  // Half of the first bin counts: 50 samples in [0.25, 0.5).
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kFloat32, samples, {0, 50}, 0.25),
            (ScalarSpan{0.25, 0.625}));
}

TEST(SpanOfPercentilesTest, WideBinsOfIntegersAreSpreadToo) {
  // 4 values a bin.
  const SampleHistogram samples = Counts(2, -1, {10, 10});
  EXPECT_EQ(SpanOfPercentiles(ScalarType::kInt32, samples, {25, 100}, {}), (ScalarSpan{-2, 4}));
}

// The definition: so many samples lie below, and so many at or below.
TEST(SpanOfPercentilesTest, SharesOfRandomSamplesAreThoseAskedFor) {
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    std::vector<int> values(1 + random() % 400);
    std::vector<std::int64_t> counts(50, 0);
    for (int& value : values) {
      value = static_cast<int>(random() % 50);
      ++counts[static_cast<std::size_t>(value)];
    }
    std::sort(values.begin(), values.end());
    const double least = static_cast<double>(random() % 60) - 5.5;
    std::vector<int> counted;
    std::copy_if(values.begin(), values.end(), std::back_inserter(counted),
                 [&](int value) { return value >= least; });
    if (counted.empty()) {
      counted = values;
    }
    const double low = static_cast<double>(random() % 50);
    const double high = low + 1 + static_cast<double>(random() % 49);
    const auto span =
        SpanOfPercentiles(ScalarType::kUint8, Counts(0, 0, counts), {low, high}, least);
    ASSERT_TRUE(span.has_value());
    for (const auto& [percent, value] : {std::pair(low, span->min), {high, span->max}}) {
      const auto at_most = static_cast<double>(
          std::upper_bound(counted.begin(), counted.end(), value) - counted.begin());
      const auto below = static_cast<double>(
          std::lower_bound(counted.begin(), counted.end(), value) - counted.begin());
      const double wanted = static_cast<double>(counted.size()) * percent / 100;
      EXPECT_GE(at_most, wanted - 1e-9);
      EXPECT_LE(below, wanted + 1e-9);
    }
  }
}

}  // namespace
}  // namespace isoscope::picture
