// Spans and thresholds, for every sample type:
//
// - the threshold compares as the isovalue does in double, NaN included;
// - ActiveBlocks equals IsActive of each span, for any vectors and for damaged NaN;
// - the bytes of the table, and sizes that are refused.

#include "core/volume/range_table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "hwy/highway.h"

namespace isoscope::volume {
namespace {

constexpr std::array<ScalarType, 8> kAllTypes{
    ScalarType::kUint8,  ScalarType::kInt8,  ScalarType::kUint16,  ScalarType::kInt16,
    ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64};

// Extremes, zero and its neighbours, and random values of T.
template <typename T>
std::vector<T> InterestingValues() {
  using Limits = std::numeric_limits<T>;
  std::vector<T> values;
  values.reserve(40);
  for (const T value : {Limits::lowest(), Limits::max(), T{0}, T{1}, T{100}}) {
    values.push_back(value);
  }
  if constexpr (std::is_floating_point_v<T>) {
    for (const T value : {Limits::infinity(), -Limits::infinity(), Limits::min(),
                          Limits::denorm_min(), -Limits::denorm_min(), T(0.1), T(-0.1)}) {
      values.push_back(value);
    }
  } else {
    for (const T value : {static_cast<T>(Limits::max() - 1), static_cast<T>(Limits::lowest() + 1),
                          static_cast<T>(-1)}) {
      values.push_back(value);
    }
  }
  for (std::uint64_t i = 0; i < 20; ++i) {
    values.push_back(static_cast<T>(100 * base::RandomUnit(5, i)));
  }
  return values;
}

// The values themselves, their neighbours in double, halves, and far outside.
template <typename T>
std::vector<double> InterestingIsovalues() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<double> isovalues{0.5, -0.5, 1e308, -1e308, 1e39, -1e39};
  for (const T value : InterestingValues<T>()) {
    const auto exact = static_cast<double>(value);
    for (const double isovalue : {exact, std::nextafter(exact, kInfinity),
                                  std::nextafter(exact, -kInfinity), exact + 0.5}) {
      if (std::isfinite(isovalue)) {
        isovalues.push_back(isovalue);
      }
    }
  }
  return isovalues;
}

TEST(ScalarSpanTest, ThresholdComparesAsTheIsovalueDoesInDouble) {
  for (const ScalarType type : kAllTypes) {
    VisitScalarType(type, []<typename T>() {
      for (const double isovalue : InterestingIsovalues<T>()) {
        const Threshold<T> threshold = InsideThreshold<T>(isovalue);
        for (const T value : InterestingValues<T>()) {
          EXPECT_EQ(threshold.any && value >= threshold.value,
                    static_cast<double>(value) >= isovalue)
              << absl::StrCat(static_cast<double>(value), " at isovalue ", isovalue);
        }
      }
    });
  }
}

TEST(ScalarSpanTest, NanIsNeverInside) {
  const auto nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(nan >= InsideThreshold<float>(-1e30).value);
}

TEST(ScalarSpanTest, ActiveIffOneEndIsBelowAndTheOtherIsNot) {
  EXPECT_TRUE(IsActive({1, 3}, 2));
  EXPECT_TRUE(IsActive({1, 3}, 3));
  EXPECT_FALSE(IsActive({1, 3}, 1));
  EXPECT_FALSE(IsActive({2, 2}, 2));
  EXPECT_FALSE(IsActive({1, 3}, 3.0000001));
  EXPECT_FALSE(IsActive(ScalarSpan{}, 0));
}

TEST(RangeTableTest, ActiveBlocksAreThoseWhoseSpansAreActiveForEveryType) {
  for (const ScalarType type : kAllTypes) {
    VisitScalarType(type, [type]<typename T>() {
      const std::vector<T> values = InterestingValues<T>();
      std::vector<ScalarSpan> spans;
      for (const T low : values) {
        for (const T high : values) {
          if (low <= high) {
            spans.push_back({static_cast<double>(low), static_cast<double>(high)});
          }
        }
      }
      spans.emplace_back();  // an empty one
      RangeTable table(type, static_cast<std::int64_t>(spans.size()));
      for (std::size_t i = 0; i < spans.size(); ++i) {
        table.Set(static_cast<BlockId>(i), spans[i]);
      }
      for (const double isovalue : InterestingIsovalues<T>()) {
        const BlockSet active = table.ActiveBlocks(isovalue);
        std::int64_t count = 0;
        for (std::size_t i = 0; i < spans.size(); ++i) {
          const bool expected = IsActive(spans[i], isovalue);
          count += expected ? 1 : 0;
          EXPECT_EQ(active.Contains(static_cast<BlockId>(i)), expected) << absl::StrCat(
              NameOf(type), " [", spans[i].min, ", ", spans[i].max, "] at ", isovalue);
        }
        EXPECT_EQ(active.Count(), count);
      }
    });
  }
}

// A stab of an interval tree at a label, and one right above it, find all blocks of the label.
TEST(RangeTableTest, BlocksOfLabelsAreThoseOfTheirStabs) {
  for (const ScalarType type : kAllTypes) {
    VisitScalarType(type, [type]<typename T>() {
      const std::vector<T> values = InterestingValues<T>();
      std::vector<ScalarSpan> spans(1);  // an empty one
      for (const T low : values) {
        for (const T high : values) {
          if (low <= high) {
            spans.push_back({static_cast<double>(low), static_cast<double>(high)});
          }
        }
      }
      RangeTable table(type, static_cast<std::int64_t>(spans.size()));
      for (std::size_t i = 0; i < spans.size(); ++i) {
        table.Set(static_cast<BlockId>(i), spans[i]);
      }
      constexpr double kMax = std::numeric_limits<double>::max();
      std::vector<double> labels = InterestingIsovalues<T>();
      std::erase(labels, kMax);  // nothing that is finite is above it
      for (std::size_t i = 0; i < labels.size(); ++i) {
        const std::vector<double> chosen = {labels[i], labels[(i * 7 + 1) % labels.size()]};
        BlockSet expected(table.block_count());
        for (const double label : chosen) {
          expected.UnionWith(table.ActiveBlocks(label));
          expected.UnionWith(table.ActiveBlocks(std::nextafter(label, kMax)));
        }
        EXPECT_EQ(table.ActiveBlocks(InsideRule::OfLabels(chosen)), expected)
            << NameOf(type) << " " << chosen[0] << ", " << chosen[1];
      }
    });
  }
}

TEST(RangeTableTest, ActiveBlocksAreTheSameWhateverTheProcessorsVectors) {
  constexpr double kIsovalue = 50;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    for (const ScalarType type : kAllTypes) {
      for (const std::int64_t count : {1, 63, 64, 65, 128, 1000}) {
        RangeTable table(type, count);
        BlockSet expected(count);
        for (std::int64_t id = 0; id < count; ++id) {
          const auto block = static_cast<BlockId>(id);
          const auto counter = static_cast<std::uint64_t>(2 * id);
          ScalarSpan span;  // one in three is empty
          if (id % 3 != 0) {
            span.min = std::floor(100 * base::RandomUnit(1, counter));
            span.max =
                std::min(127.0, span.min + std::floor(60 * base::RandomUnit(1, counter + 1)));
          }
          table.Set(block, span);
          if (IsActive(span, kIsovalue)) {
            expected.Insert(block);
          }
        }
        EXPECT_EQ(table.ActiveBlocks(kIsovalue), expected)
            << absl::StrCat(hwy::TargetName(target), " ", NameOf(type), " ", count);
      }
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(RangeTableTest, NanFromADamagedFileIsNeverActive) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> values;
  for (int i = 0; i < 70; ++i) {
    values.push_back(i % 3 == 0 ? nan : 1.0F);
    values.push_back(i % 3 == 1 ? nan : 3.0F);
  }
  std::string bytes(values.size() * sizeof(float), 0);
  std::memcpy(bytes.data(), values.data(), bytes.size());
  const std::vector<BlockId> active =
      RangeTable::FromBytes(ScalarType::kFloat32, 70, bytes).ActiveBlocks(2).Ids();
  EXPECT_EQ(active.size(), 23U);
  for (const BlockId id : active) {
    EXPECT_EQ(id % 3, 2U);
  }
}

TEST(RangeTableTest, SpansComeBackAndTotalCoversThem) {
  RangeTable table(ScalarType::kInt16, 3);
  EXPECT_GT(table.Get(1).min, table.Get(1).max);
  EXPECT_EQ(table.Total(), ScalarSpan{});
  table.Set(0, {-7, 20});
  table.Set(2, {-32768, 3});
  EXPECT_EQ(table.Get(0), (ScalarSpan{-7, 20}));
  EXPECT_EQ(table.Get(2), (ScalarSpan{-32768, 3}));
  EXPECT_EQ(table.Total(), (ScalarSpan{-32768, 20}));
  table.Set(2, ScalarSpan{});
  EXPECT_EQ(table.Total(), (ScalarSpan{-7, 20}));
}

TEST(RangeTableTest, BytesAreLittleEndianPairsInBlockOrder) {
  RangeTable table(ScalarType::kUint16, 2);
  table.Set(0, {1, 0x0203});
  table.Set(1, {4, 5});
  EXPECT_EQ(table.bytes(), std::string("\x01\x00\x03\x02\x04\x00\x05\x00", 8));
  const RangeTable copy = RangeTable::FromBytes(ScalarType::kUint16, 2, table.bytes());
  EXPECT_EQ(copy.Get(0), table.Get(0));
  EXPECT_EQ(copy.Get(1), table.Get(1));
}

TEST(RangeTableDeathTest, BytesOfTheWrongSizeAreRefused) {
  EXPECT_DEATH(RangeTable::FromBytes(ScalarType::kUint16, 2, "1234567"), "bytes.size");
}

}  // namespace
}  // namespace isoscope::volume
