#include "core/volume/label_suggestion.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::volume {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// Counts of values, exact as those of integers of a small range.
SampleHistogram HistogramOf(const std::vector<std::pair<std::int64_t, std::int64_t>>& counts) {
  SampleHistogram histogram;
  histogram.bins = {.exponent = 0,
                    .first = counts.front().first,
                    .count = counts.back().first - counts.front().first + 1};
  histogram.counts.resize(static_cast<std::size_t>(histogram.bins.count));
  for (const auto& [value, count] : counts) {
    histogram.counts[static_cast<std::size_t>(value - histogram.bins.first)] = count;
  }
  return histogram;
}

// Counts of the values 0, 1, 2, ...
SampleHistogram CurveOf(const std::vector<double>& counts) {
  std::vector<std::pair<std::int64_t, std::int64_t>> pairs;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    pairs.emplace_back(static_cast<std::int64_t>(i), std::llround(counts[i]));
  }
  return HistogramOf(pairs);
}

std::vector<double> Suggested(const SampleHistogram& histogram,
                              const std::vector<Label>& named = {}) {
  return SuggestLabels(ScalarType::kUint8, histogram, named);
}

TEST(SuggestLabelsTest, FewIntegersAreLabelsButZero) {
  EXPECT_THAT(Suggested(HistogramOf({{0, 200'000}, {1, 900}})), ElementsAre(1)) << "a mask";
  EXPECT_THAT(Suggested(HistogramOf({{0, 90'000}, {255, 70'000}})), ElementsAre(255));
  EXPECT_THAT(Suggested(HistogramOf({{-2, 20'000}, {3, 10'000}, {9, 8000}})),
              ElementsAre(-2, 3, 9));
  EXPECT_THAT(Suggested(HistogramOf({{0, 600'000}, {1, 90'000}, {2, 190'000}, {3, 160'000}})),
              ElementsAre(1, 2, 3))
      << "tissues of a brain";
}

TEST(SuggestLabelsTest, FewSamplesOneValueAndFloatsAreNot) {
  EXPECT_THAT(Suggested(HistogramOf({{0, 32'000}, {1, 767}})), IsEmpty());
  EXPECT_THAT(Suggested(HistogramOf({{0, 32'000}, {1, 768}})), ElementsAre(1));
  EXPECT_THAT(Suggested(HistogramOf({{7, 99'000}})), IsEmpty()) << "nothing to see";
  const SampleHistogram mask = HistogramOf({{0, 200'000}, {1, 900}});
  EXPECT_THAT(SuggestLabels(ScalarType::kFloat32, mask, {}), IsEmpty());
  EXPECT_THAT(SuggestLabels(ScalarType::kFloat64, mask, {}), IsEmpty());
  SampleHistogram coarse = mask;
  coarse.bins.exponent = 1;
  EXPECT_THAT(SuggestLabels(ScalarType::kInt32, coarse, {}), IsEmpty());
  EXPECT_THAT(Suggested(SampleHistogram()), IsEmpty()) << "no finite sample";
}

TEST(SuggestLabelsTest, ARampIsNotWhateverItsLength) {
  for (const std::size_t size : {4U, 9U, 16U, 60U, 128U}) {
    std::vector<double> counts(size, 20'000);
    counts.front() = counts.back() = 10'000;  // half of a step rounds to each end
    EXPECT_THAT(Suggested(CurveOf(counts)), IsEmpty()) << size;
  }
}

// A background, and peaks as of an image, with noise.
SampleHistogram ImageOf(std::size_t size, std::uint64_t seed) {
  std::vector<double> counts(size);
  for (std::size_t i = 0; i < size; ++i) {
    const double at = static_cast<double>(i) / static_cast<double>(size);
    const double fat = std::exp(-std::pow((at - 0.3) / 0.06, 2));
    const double muscle = std::exp(-std::pow((at - 0.55) / 0.08, 2));
    counts[i] = 40'000 * (fat + 0.7 * muscle + 0.02) * (1 + 0.1 * base::RandomUnit(seed, i));
  }
  counts[0] = 4'000'000;
  return CurveOf(counts);
}

TEST(SuggestLabelsTest, AnImageOfAnyDepthIsNot) {
  for (const std::size_t size : {20U, 32U, 64U, 100U, 128U}) {
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      EXPECT_THAT(Suggested(ImageOf(size, seed)), IsEmpty()) << size << ", " << seed;
    }
  }
}

// Parts of any size; of an atlas, left and right ones that differ by little.
SampleHistogram AtlasOf(std::size_t pairs, std::uint64_t seed) {
  std::vector<double> counts{3'000'000};
  for (std::uint64_t i = 0; i < pairs; ++i) {
    const double size = 300 * std::pow(100, base::RandomUnit(seed, i));
    counts.push_back(size * (0.95 + 0.1 * base::RandomUnit(seed + 1000, 2 * i)));
    counts.push_back(size * (0.95 + 0.1 * base::RandomUnit(seed + 1000, 2 * i + 1)));
  }
  return CurveOf(counts);
}

TEST(SuggestLabelsTest, AnAtlasIs) {
  for (const std::size_t pairs : {25U, 58U, 64U}) {
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      EXPECT_THAT(Suggested(AtlasOf(pairs, seed)), SizeIs(2 * pairs)) << pairs << ", " << seed;
    }
  }
  EXPECT_THAT(Suggested(AtlasOf(65, 1)), IsEmpty()) << "more than a frame has surfaces";
}

TEST(SuggestLabelsTest, NamesDecideForAnyTypeAndOfManyTheLargestAreTaken) {
  const std::vector<Label> named{{.value = 0, .name = "air"},
                                 {.value = 3, .name = "lung"},
                                 {.value = 5, .name = "liver"},
                                 {.value = 77, .name = "unused"}};
  const SampleHistogram small = HistogramOf({{0, 20}, {3, 5}, {5, 1}, {6, 1}});
  for (const ScalarType type : {ScalarType::kUint8, ScalarType::kInt32, ScalarType::kFloat32}) {
    EXPECT_THAT(SuggestLabels(type, small, named), ElementsAre(3, 5));
  }
  // Names in the header of what is no segmentation.
  EXPECT_THAT(Suggested(ImageOf(100, 1), named), IsEmpty());
  // Names of none of the samples: the samples decide.
  EXPECT_THAT(Suggested(HistogramOf({{0, 90'000}, {255, 70'000}}), named), ElementsAre(255));

  std::vector<Label> many;
  std::vector<std::pair<std::int64_t, std::int64_t>> counts;
  for (std::int64_t value = 0; value < 200; ++value) {
    many.push_back({.value = static_cast<double>(value), .name = "part"});
    counts.emplace_back(value, value == 150 ? 5 : 1000 - value);
  }
  const std::vector<double> largest = Suggested(HistogramOf(counts), many);
  ASSERT_THAT(largest, SizeIs(kMaxSuggestedLabels));
  EXPECT_EQ(largest.front(), 1);
  EXPECT_EQ(largest.back(), 128);
}

// 4 values in a bin, as of int32 of a wide range.
TEST(SuggestLabelsTest, NamesAreFoundInCoarseBins) {
  SampleHistogram histogram;
  histogram.bins = {.exponent = 2, .first = 0, .count = 3};
  histogram.counts = {900, 0, 50};
  const std::vector<Label> named{{.value = 2, .name = "a"},
                                 {.value = 5, .name = "b"},
                                 {.value = 8, .name = "c"},
                                 {.value = 11, .name = "d"}};
  EXPECT_THAT(SuggestLabels(ScalarType::kInt32, histogram, named), ElementsAre(2, 8, 11));
}

}  // namespace
}  // namespace isoscope::volume
