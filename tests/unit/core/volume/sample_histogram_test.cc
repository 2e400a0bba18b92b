#include "core/volume/sample_histogram.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kMaxDouble = std::numeric_limits<double>::max();

TEST(HistogramBinsTest, IntegersOfFewValuesAreExactAndOthersHaveTwoToFourThousandBins) {
  EXPECT_EQ(BinsOf(ScalarType::kUint8, {3, 250}), (HistogramBins{0, 3, 248}));
  EXPECT_EQ(BinsOf(ScalarType::kInt16, {-1024, 3071}), (HistogramBins{0, -1024, 4096}));
  EXPECT_EQ(BinsOf(ScalarType::kInt16, {-1024, 3072}), (HistogramBins{1, -512, 2049}));
  EXPECT_EQ(BinsOf(ScalarType::kUint16, {0, 65535}), (HistogramBins{4, 0, 4096}));
  EXPECT_EQ(BinsOf(ScalarType::kUint32, {0, 4294967295.0}), (HistogramBins{20, 0, 4096}));
  EXPECT_EQ(BinsOf(ScalarType::kFloat32, {0, 1}), (HistogramBins{-11, 0, 2049}));
  EXPECT_EQ(BinsOf(ScalarType::kInt32, {7, 7}), (HistogramBins{0, 7, 1}));
  EXPECT_EQ(BinsOf(ScalarType::kUint8, ScalarSpan{}).count, 0);
}

TEST(HistogramBinsTest, EveryRangeOfDoublesIsCoveredByAFewThousandBins) {
  const std::vector<double> ends = {-kMaxDouble, -1e30, -1, -1e-300, -5e-324,  0,    5e-324,
                                    1e-300,      0.1,   1,  1e15,    1e15 + 1, 1e30, kMaxDouble};
  for (const double min : ends) {
    for (const double max : ends) {
      if (!(min <= max)) {
        continue;
      }
      SCOPED_TRACE(::testing::Message() << min << " to " << max);
      const HistogramBins bins = BinsOf(ScalarType::kFloat64, {min, max});
      ASSERT_GE(bins.count, 1);
      ASSERT_LE(bins.count, kMaxHistogramBins);
      EXPECT_GE(bins.exponent, kMinHistogramExponent);
      EXPECT_LE(bins.exponent, kMaxHistogramExponent);
      EXPECT_EQ(bins.IndexOf(min), 0);
      EXPECT_EQ(bins.IndexOf(max), bins.count - 1);
      EXPECT_LE(bins.EdgeOf(0), min);
      EXPECT_TRUE(max < bins.EdgeOf(bins.count) || max == kMaxDouble);
      EXPECT_LE(std::abs(bins.first), std::int64_t{1} << 53);
    }
  }
}

TEST(HistogramBinsTest, BinsOfAWiderRangeAreMadeOfWholeBinsOfANarrowerOne) {
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const auto random = [&](std::uint64_t k) {
      const double mantissa = static_cast<double>(base::RandomBits(i, k) >> 12) * 0x1p-52 - 0.5;
      return std::ldexp(mantissa, static_cast<int>(base::RandomBits(i, k + 10) % 200) - 100);
    };
    ScalarSpan narrow{random(0), random(1)};
    if (narrow.min > narrow.max) {
      std::swap(narrow.min, narrow.max);
    }
    ScalarSpan wide{std::min(narrow.min, random(2)), std::max(narrow.max, random(3))};
    const HistogramBins a = BinsOf(ScalarType::kFloat64, narrow);
    const HistogramBins b = BinsOf(ScalarType::kFloat64, wide);
    ASSERT_LE(a.exponent, b.exponent);
    const int shift = std::min(b.exponent - a.exponent, 63);
    for (const double value : {narrow.min, narrow.max, 0.5 * narrow.min + 0.5 * narrow.max}) {
      ASSERT_EQ((a.first + a.IndexOf(value)) >> shift, b.first + b.IndexOf(value)) << value;
    }
  }
}

TEST(CountedSamplesTest, EverySampleBelongsToExactlyOneBlock) {
  for (const math::Index3& dims : {math::Index3{11, 7, 9}, {2, 2, 2}, {17, 5, 3}}) {
    for (const math::Index3& cells : {math::Index3{4, 4, 4}, {1, 3, 2}, {16, 16, 16}}) {
      const BlockLayout layout = BlockLayout::Make(dims, cells).value();
      std::vector<int> owners(static_cast<std::size_t>(math::Volume(dims)));
      for (std::int64_t id = 0; id < layout.block_count(); ++id) {
        const math::IndexBox box = CountedSamplesOf(layout, static_cast<BlockId>(id));
        for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
          for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
            for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
              ++owners[static_cast<std::size_t>((z * dims.y + y) * dims.x + x)];
            }
          }
        }
      }
      EXPECT_THAT(owners, ::testing::Each(1));
    }
  }
}

TEST(GroupBinsTest, GroupsAreEqualCoverTheRangeAndAreNoMoreThanAskedFor) {
  const HistogramBins bins{.exponent = 0, .first = 10, .count = 100};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(BinGroups groups, GroupBins(bins, 256, std::nullopt));
  EXPECT_EQ(groups, (BinGroups{bins, 0, 1, 100}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(groups, GroupBins(bins, 30, std::nullopt));
  EXPECT_EQ(groups, (BinGroups{bins, 0, 4, 25}));
  EXPECT_EQ(groups.LowerEdgeOf(1), 14);
  EXPECT_EQ(groups.CenterOf(0), 12);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(groups, GroupBins(bins, 1, std::nullopt));
  EXPECT_EQ(groups, (BinGroups{bins, 0, 100, 1}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(groups, GroupBins(bins, 3, ScalarSpan{20.5, 29}));
  EXPECT_EQ(groups, (BinGroups{bins, 10, 4, 3}));
  EXPECT_EQ(groups.EndOf(2), 22) << "the last group overhangs what was asked for, not the bins";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(groups, GroupBins(bins, 7, ScalarSpan{-kMaxDouble, kMaxDouble}));
  EXPECT_EQ(groups.EndOf(groups.count - 1), 100);
  for (const ScalarSpan& outside : {ScalarSpan{0, 9.9}, ScalarSpan{110, 1e300}}) {
    EXPECT_THAT(GroupBins(bins, 5, outside),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("10 to 110")));
  }
  EXPECT_THAT(GroupBins({}, 5, ScalarSpan{0, 1}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no finite sample")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(groups, GroupBins({}, 5, std::nullopt));
  EXPECT_EQ(groups.count, 0);
}

TEST(GroupBinsTest, SumsOfGroupsAddUpToAllBinsOfTheRange) {
  const HistogramBins bins{.exponent = -3, .first = -50, .count = 101};
  std::vector<std::int64_t> counts(101);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] = static_cast<std::int64_t>(i * i);
  }
  for (std::int64_t n = 1; n < 120; ++n) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BinGroups groups, GroupBins(bins, n, std::nullopt));
    EXPECT_LE(groups.count, n);
    std::int64_t sum = 0;
    for (std::int64_t g = 0; g < groups.count; ++g) {
      sum += groups.SumOf(counts, g);
    }
    EXPECT_EQ(sum, 100 * 101 * 201 / 6) << n;
  }
}

TEST(HistogramPartTest, PartsAddUpAndOneWithoutSamplesLeavesTheSumWithout) {
  const HistogramBins bins{.exponent = 0, .first = 0, .count = 2};
  const BinGroups groups{bins, 0, 1, 2};
  HistogramPart a{groups, {1, 2}, {10, 20}, {100, 200}, SampleHistogram{bins, {5, 6}, 1, 2, 3},
                  {0, 1}};
  const HistogramPart b{
      groups, {3, 4}, {30, 40}, {300, 400}, SampleHistogram{bins, {7, 8}, 10, 20, 30}, {0, 1}};
  ISOSCOPE_ASSERT_OK(AddPart(b, &a));
  EXPECT_THAT(a.active_block_counts, ElementsAre(4, 6));
  EXPECT_THAT(a.active_block_bytes, ElementsAre(40, 60));
  EXPECT_THAT(a.estimated_triangle_counts, ElementsAre(400, 600));
  EXPECT_EQ(*a.samples, (SampleHistogram{bins, {12, 14}, 11, 22, 33}));
  EXPECT_EQ(a.samples->TotalCount(), 12 + 14 + 11 + 22 + 33);
  EXPECT_FALSE(a.label_values.has_value());
  HistogramPart labels = b;
  labels.label_values = LabelValues::Of({1, 3}, false, std::nullopt);
  HistogramPart sum = labels;
  labels.label_values = LabelValues::Of({2}, false, std::nullopt);
  ISOSCOPE_ASSERT_OK(AddPart(labels, &sum));
  EXPECT_THAT(sum.label_values->values(), ElementsAre(1, 2, 3));
  ISOSCOPE_ASSERT_OK(AddPart(b, &sum));
  EXPECT_FALSE(sum.label_values.has_value());
  HistogramPart without = b;
  without.samples.reset();
  ISOSCOPE_ASSERT_OK(AddPart(without, &a));
  EXPECT_FALSE(a.samples.has_value());
  HistogramPart other = b;
  other.groups.bins.exponent = 1;
  EXPECT_THAT(AddPart(other, &a), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(HistogramPartTest, PartsAreOfOneRangeAndThoseOfBeforeHaveNone) {
  const BinGroups groups{{.exponent = 0, .first = 0, .count = 2}, 0, 1, 2};
  const HistogramPart known{groups, {1, 2}, {10, 20}, {100, 200}, std::nullopt, {0, 1}};
  HistogramPart unknown = known;
  unknown.value_range = {};
  HistogramPart other = known;
  other.value_range = {0, 2};
  HistogramPart sum = unknown;
  ISOSCOPE_ASSERT_OK(AddPart(unknown, &sum));
  EXPECT_EQ(sum.value_range, ScalarSpan());
  ISOSCOPE_ASSERT_OK(AddPart(known, &sum));
  EXPECT_EQ(sum.value_range, known.value_range);
  ISOSCOPE_ASSERT_OK(AddPart(unknown, &sum));
  EXPECT_EQ(sum.value_range, known.value_range);
  EXPECT_THAT(AddPart(other, &sum), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(EstimateTrianglesTest, GrowsWithTheAreaOfAFace) {
  EXPECT_EQ(EstimateTriangles({8, 8, 8}), 179);     // 2.8 * 64
  EXPECT_EQ(EstimateTriangles({16, 16, 16}), 717);  // 2.8 * 256
  EXPECT_EQ(EstimateTriangles({1, 1, 1}), 3);
}

}  // namespace
}  // namespace isoscope::volume
