#include "core/volume/range_table.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"

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
