#include "core/volume/isovalue_suggestions.h"

#include <cmath>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::volume {
namespace {

using ::testing::IsEmpty;

// Integers, exactly: counts of the values from `first` on.
SampleHistogram Integers(std::int64_t first, std::vector<std::int64_t> counts) {
  SampleHistogram histogram;
  histogram.bins = {
      .exponent = 0, .first = first, .count = static_cast<std::int64_t>(counts.size())};
  histogram.counts = std::move(counts);
  return histogram;
}

std::vector<IsovalueSuggestion> Suggest(ScalarType type, const SampleHistogram& histogram) {
  return SuggestIsovalues(type, histogram, 0, histogram.bins.count);
}

TEST(IsovalueSuggestionsTest, TwoValuesAreSeparatedInTheMiddleOfTheirGap) {
  std::vector<std::int64_t> counts(41);
  counts[0] = 700;   // value 10
  counts[40] = 300;  // value 50
  const auto suggestions = Suggest(ScalarType::kUint8, Integers(10, counts));
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[0].method, SuggestionMethod::kBetweenClasses);
  EXPECT_EQ(suggestions[0].isovalue, 30);
  EXPECT_DOUBLE_EQ(suggestions[0].inside_fraction, 0.3);
  EXPECT_EQ(suggestions[1].method, SuggestionMethod::kOnePercent);
  EXPECT_EQ(suggestions[1].isovalue, 49.5) << "no other level encloses less";
  EXPECT_DOUBLE_EQ(suggestions[1].inside_fraction, 0.3);
}

// Otsu's closed form for two boxes of equal size: the middle.
TEST(IsovalueSuggestionsTest, TwoBoxesAreSeparatedBetweenThem) {
  std::vector<std::int64_t> counts(100);
  for (std::size_t i = 0; i < 20; ++i) {
    counts[i] = 50;
    counts[80 + i] = 50;
  }
  const auto suggestions = Suggest(ScalarType::kInt16, Integers(-50, counts));
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[0].isovalue, 0.5 * (-50 + 19) + 0.5 * (-50 + 80));
  EXPECT_DOUBLE_EQ(suggestions[0].inside_fraction, 0.5);
}

// In a uniform distribution the two halves differ most.
TEST(IsovalueSuggestionsTest, UniformSamplesAreHalvedAndTheTopPercentIsTheTopPercent) {
  const auto suggestions =
      Suggest(ScalarType::kUint16, Integers(0, std::vector<std::int64_t>(200, 7)));
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[0].isovalue, 99.5);
  EXPECT_DOUBLE_EQ(suggestions[0].inside_fraction, 0.5);
  EXPECT_EQ(suggestions[1].isovalue, 197.5);
  EXPECT_DOUBLE_EQ(suggestions[1].inside_fraction, 0.01);
}

TEST(IsovalueSuggestionsTest, BruteForceFindsNoBetterBorder) {
  std::vector<std::int64_t> counts;
  for (int i = 0; i < 256; ++i) {  // two bells of different size and width
    const auto bell = [i](double center, double width, double size) {
      return size * std::exp(-0.5 * std::pow((i - center) / width, 2));
    };
    counts.push_back(std::lround(bell(40, 12, 90000) + bell(150, 30, 20000)));
  }
  const SampleHistogram histogram = Integers(0, counts);
  double total = 0;
  double sum = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    total += static_cast<double>(counts[i]);
    sum += static_cast<double>(counts[i]) * static_cast<double>(i);
  }
  const auto variance = [&](double isovalue) {
    double n = 0;
    double s = 0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (static_cast<double>(i) < isovalue) {
        n += static_cast<double>(counts[i]);
        s += static_cast<double>(counts[i]) * static_cast<double>(i);
      }
    }
    const double difference = (sum - s) / (total - n) - s / n;
    return n * (total - n) * difference * difference;
  };
  const auto suggestions = Suggest(ScalarType::kUint8, histogram);
  ASSERT_EQ(suggestions.size(), 2u);
  const double found = suggestions[0].isovalue;
  EXPECT_GT(found, 40);
  EXPECT_LT(found, 150);
  for (double isovalue = 0.5; isovalue < 255; ++isovalue) {
    EXPECT_LE(variance(isovalue), variance(found) * (1 + 1e-9)) << isovalue;
  }
}

TEST(IsovalueSuggestionsTest, FloatsAreSeparatedAtTheEdgesOfBins) {
  SampleHistogram histogram;
  histogram.bins = {.exponent = -2, .first = 4, .count = 9};  // [1, 3.25) in quarters
  histogram.counts = {60, 0, 0, 0, 0, 0, 0, 0, 40};
  const auto suggestions = Suggest(ScalarType::kFloat32, histogram);
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[0].isovalue, 0.5 * 1.25 + 0.5 * 3.0);
  EXPECT_EQ(suggestions[1].isovalue, 3.0);
  EXPECT_DOUBLE_EQ(suggestions[1].inside_fraction, 0.4);
}

TEST(IsovalueSuggestionsTest, OnlyTheBinsThatWereAskedForCount) {
  std::vector<std::int64_t> counts(101);
  counts[0] = 1'000'000;  // air
  counts[50] = 99;
  counts[100] = 1;
  const SampleHistogram histogram = Integers(0, counts);
  const auto suggestions = SuggestIsovalues(ScalarType::kUint8, histogram, 1, 101);
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[0].isovalue, 75);
  EXPECT_EQ(suggestions[1].isovalue, 99.5);
  EXPECT_DOUBLE_EQ(suggestions[1].inside_fraction, 0.01);
}

TEST(IsovalueSuggestionsTest, OneValueOrNoneSuggestsNothing) {
  EXPECT_THAT(Suggest(ScalarType::kUint8, Integers(7, {12})), IsEmpty());
  EXPECT_THAT(Suggest(ScalarType::kUint8, Integers(7, {0, 12, 0})), IsEmpty());
  EXPECT_THAT(Suggest(ScalarType::kUint8, {}), IsEmpty());
}

TEST(IsovalueSuggestionsTest, MostSamplesAtTheBottomStillGiveASurface) {
  const auto suggestions = Suggest(ScalarType::kUint8, Integers(0, {100'000, 0, 3}));
  ASSERT_EQ(suggestions.size(), 2u);
  EXPECT_EQ(suggestions[1].isovalue, 1.5) << "3 of 100 003 are less than 1 %, but 0 encloses all";
  EXPECT_LT(suggestions[1].inside_fraction, 0.01);
}

}  // namespace
}  // namespace isoscope::volume
