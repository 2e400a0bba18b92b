#include "core/volume/volume_level.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/math/matrix.h"
#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <typename T>
constexpr ScalarType TypeOf() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return ScalarType::kUint8;
  if constexpr (std::is_same_v<T, std::int8_t>) return ScalarType::kInt8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return ScalarType::kUint16;
  if constexpr (std::is_same_v<T, std::int16_t>) return ScalarType::kInt16;
  if constexpr (std::is_same_v<T, std::uint32_t>) return ScalarType::kUint32;
  if constexpr (std::is_same_v<T, std::int32_t>) return ScalarType::kInt32;
  if constexpr (std::is_same_v<T, float>) return ScalarType::kFloat32;
  return ScalarType::kFloat64;
}

template <typename T>
using Rows = std::array<std::vector<T>, 4>;

// The rows lie one byte behind an aligned address, as they may.
template <typename Out, typename T>
std::vector<Out> Reduce(const Rows<T>& rows, LevelFilter filter) {
  std::array<std::string, 4> bytes;
  std::array<const char*, 4> pointers{};
  for (std::size_t row = 0; row < rows.size(); ++row) {
    bytes[row].assign(1 + rows[row].size() * sizeof(T), '\0');
    std::memcpy(bytes[row].data() + 1, rows[row].data(), rows[row].size() * sizeof(T));
    pointers[row] = bytes[row].data() + 1;
  }
  const std::size_t count = rows[0].size() / 2;
  std::string out(1 + count * sizeof(Out), '\x55');
  ReduceRows(TypeOf<T>(), TypeOf<Out>(), filter, pointers, count, out.data() + 1);
  EXPECT_EQ(out[0], '\x55');
  std::vector<Out> result(count);
  std::memcpy(result.data(), out.data() + 1, count * sizeof(Out));
  return result;
}

// One result: the eight samples in the order x, y, z.
template <typename Out, typename T>
Out ReduceEight(const std::array<T, 8>& s, LevelFilter filter) {
  const Rows<T> rows{{{s[0], s[1]}, {s[2], s[3]}, {s[4], s[5]}, {s[6], s[7]}}};
  return Reduce<Out>(rows, filter)[0];
}

// Numbers of one seed, one after the other.
class Random {
 public:
  explicit Random(std::uint64_t seed) : seed_(seed) {}
  std::uint64_t Next() { return base::RandomBits(seed_, counter_++); }
  double NextUnit() { return base::RandomUnit(seed_, counter_++); }

 private:
  const std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

template <typename T>
Rows<T> RandomRows(Random* random, std::size_t count, std::uint64_t range) {
  Rows<T> rows;
  for (std::vector<T>& row : rows) {
    for (std::size_t i = 0; i < count; ++i) {
      row.push_back(static_cast<T>(random->Next() % range));
    }
  }
  return rows;
}

// The exact mean of eight integers, rounded half to even by the library of C.
template <typename T>
void ExpectRoundedMeans(std::uint64_t range) {
  Random random(7);
  const Rows<T> rows = RandomRows<T>(&random, 2 * 1000, range);
  const std::vector<T> means = Reduce<T>(rows, LevelFilter::kMean);
  for (std::size_t i = 0; i < means.size(); ++i) {
    double sum = 0;  // exact: 8 * 2^32 < 2^53
    for (const std::vector<T>& row : rows) {
      sum += static_cast<double>(row[2 * i]) + static_cast<double>(row[2 * i + 1]);
    }
    ASSERT_EQ(static_cast<double>(means[i]), std::nearbyint(sum / 8)) << i;
  }
}

TEST(ReduceRowsTest, MeansOfIntegersAreRoundedHalfToEven) {
  for (const std::uint64_t range : {std::uint64_t{3}, std::uint64_t{1} << 32}) {
    ExpectRoundedMeans<std::uint16_t>(range);
    ExpectRoundedMeans<std::int16_t>(range);
    ExpectRoundedMeans<std::uint32_t>(range);
    ExpectRoundedMeans<std::int32_t>(range);
  }
  // 12 / 8 = 1.5, 20 / 8 = 2.5, and the same below zero.
  EXPECT_EQ((ReduceEight<std::int16_t, std::int16_t>({12}, LevelFilter::kMean)), 2);
  EXPECT_EQ((ReduceEight<std::int16_t, std::int16_t>({20}, LevelFilter::kMean)), 2);
  EXPECT_EQ((ReduceEight<std::int16_t, std::int16_t>({-12}, LevelFilter::kMean)), -2);
  EXPECT_EQ((ReduceEight<std::int16_t, std::int16_t>({-20}, LevelFilter::kMean)), -2);
}

TEST(ReduceRowsTest, MeansOfTheLargestIntegersDoNotOverflow) {
  std::array<std::uint32_t, 8> most{};
  most.fill(std::numeric_limits<std::uint32_t>::max());
  EXPECT_EQ((ReduceEight<std::uint32_t>(most, LevelFilter::kMean)), most[0]);
  std::array<std::int32_t, 8> least{};
  least.fill(std::numeric_limits<std::int32_t>::min());
  EXPECT_EQ((ReduceEight<std::int32_t>(least, LevelFilter::kMean)), least[0]);
}

TEST(ReduceRowsTest, MeansOfBytesLoseNothing) {
  Random random(11);
  const auto rows = RandomRows<std::uint8_t>(&random, 2 * 700, 256);
  const auto means = Reduce<std::uint16_t>(rows, LevelFilter::kMean);
  const auto signed_rows = RandomRows<std::int8_t>(&random, 2 * 700, 256);
  const auto signed_means = Reduce<std::int16_t>(signed_rows, LevelFilter::kMean);
  for (std::size_t i = 0; i < means.size(); ++i) {
    double sum = 0;
    double signed_sum = 0;
    for (std::size_t row = 0; row < rows.size(); ++row) {
      sum += rows[row][2 * i] + rows[row][2 * i + 1];
      signed_sum += signed_rows[row][2 * i] + signed_rows[row][2 * i + 1];
    }
    ASSERT_EQ(means[i], sum / 8 * 256) << i;
    ASSERT_EQ(signed_means[i], signed_sum / 8 * 256) << i;
  }
  std::array<std::int8_t, 8> least{};
  least.fill(-128);
  EXPECT_EQ((ReduceEight<std::int16_t>(least, LevelFilter::kMean)), -32768);
}

template <typename T>
void ExpectSequenceOfOperations() {
  Random random(13);
  Rows<T> rows;
  for (std::vector<T>& row : rows) {
    for (int i = 0; i < 2 * 600; ++i) {
      row.push_back(static_cast<T>(
          std::ldexp(random.NextUnit() - 0.5, static_cast<int>(random.Next() % 60) - 30)));
    }
  }
  const std::vector<T> means = Reduce<T>(rows, LevelFilter::kMean);
  for (std::size_t i = 0; i < means.size(); ++i) {
    const auto column = [&](std::size_t x) {
      const auto part = [&](std::size_t row) { return static_cast<double>(rows[row][x]) / 8; };
      const double front = part(0) + part(1);
      const double back = part(2) + part(3);
      return front + back;
    };
    const double mean = column(2 * i) + column(2 * i + 1);
    ASSERT_EQ(means[i], static_cast<T>(mean)) << i;
  }
}

TEST(ReduceRowsTest, MeansOfFloatsAreTheWrittenSequenceOfOperations) {
  ExpectSequenceOfOperations<float>();
  ExpectSequenceOfOperations<double>();
}

TEST(ReduceRowsTest, MeansOfTheLargestFloatsAreFinite) {
  std::array<double, 8> most{};
  most.fill(std::numeric_limits<double>::max());
  EXPECT_EQ((ReduceEight<double>(most, LevelFilter::kMean)), most[0]);
  std::array<float, 8> floats{};
  floats.fill(std::numeric_limits<float>::lowest());
  EXPECT_EQ((ReduceEight<float>(floats, LevelFilter::kMean)), floats[0]);
}

TEST(ReduceRowsTest, OneNanGivesOneBitPatternWhereverItIs) {
  const auto bits = std::bit_cast<std::uint64_t>(std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < 8; ++i) {
    std::array<double, 8> samples{1, 2, 3, 4, 5, 6, 7, 8};
    samples[i] = std::bit_cast<double>(std::uint64_t{0xfff8'0000'0000'1234} + i);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(ReduceEight<double>(samples, LevelFilter::kMean)), bits);
  }
  EXPECT_EQ(std::bit_cast<std::uint64_t>(
                ReduceEight<double>(std::array<double, 8>{kInf, -kInf}, LevelFilter::kMean)),
            bits);
  EXPECT_EQ(std::bit_cast<std::uint32_t>(ReduceEight<float>(
                std::array<float, 8>{static_cast<float>(-kNan)}, LevelFilter::kMean)),
            std::bit_cast<std::uint32_t>(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_EQ(ReduceEight<double>(std::array<double, 8>{kInf, 1, 2}, LevelFilter::kMean), kInf);
}

TEST(ReduceRowsTest, MajoritiesAreTheMostFrequentAndTheLowestOnTies) {
  using Labels = std::array<std::uint8_t, 8>;
  const auto majority = [](const Labels& labels) {
    return static_cast<int>(ReduceEight<std::uint8_t>(labels, LevelFilter::kMajority));
  };
  EXPECT_EQ(majority({9, 9, 9, 9, 9, 9, 9, 9}), 9);
  EXPECT_EQ(majority({9, 9, 9, 9, 9, 1, 2, 3}), 9);
  EXPECT_EQ(majority({9, 4, 9, 4, 9, 4, 9, 4}), 4);
  EXPECT_EQ(majority({8, 7, 6, 5, 4, 3, 2, 1}), 1);
  EXPECT_EQ(majority({0, 0, 5, 5, 5, 7, 7, 7}), 5);
  Random random(17);
  const auto rows = RandomRows<std::int32_t>(&random, 2 * 1000, 3);
  const auto majorities = Reduce<std::int32_t>(rows, LevelFilter::kMajority);
  for (std::size_t i = 0; i < majorities.size(); ++i) {
    std::map<std::int32_t, int> counts;
    for (const std::vector<std::int32_t>& row : rows) {
      ++counts[row[2 * i]];
      ++counts[row[2 * i + 1]];
    }
    std::int32_t best = counts.begin()->first;
    for (const auto& [label, count] : counts) {
      best = count > counts[best] ? label : best;
    }
    ASSERT_EQ(majorities[i], best) << i;
  }
}

TEST(VolumeLevelTest, SamplesLieAtTheCentreOfWhatTheyAreMadeOf) {
  GridGeometry grid;
  grid.sample_dims = {41, 22, 16};
  grid.spacing = {0.5, 1.25, 3};
  grid.origin = {-7, 11, 0.25};
  grid.direction.columns = {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.8, 0.6, 0},
                            math::Vec3d{0, 0, 1}};
  for (int level = 1; level <= HighestLevel(grid.sample_dims); ++level) {
    const VolumeLevel coarse = LevelOf(grid, ScalarType::kInt8, LevelFilter::kMean, level);
    EXPECT_EQ(coarse.index, level);
    EXPECT_EQ(coarse.type, ScalarType::kInt16);
    EXPECT_EQ(coarse.value_scale, 256);
    EXPECT_EQ(coarse.grid.sample_dims, LevelDims(grid.sample_dims, level));
    const double step = std::ldexp(1.0, level);
    const math::Vec3d index{1, 1, 1};
    const math::Vec3d centre = index * step + math::Vec3d{1, 1, 1} * ((step - 1) / 2);
    EXPECT_LT(math::Length(math::TransformPoint(coarse.grid.world_from_index(), index) -
                           math::TransformPoint(grid.world_from_index(), centre)),
              1e-12);
  }
  EXPECT_EQ(LevelOf(grid, ScalarType::kInt8, LevelFilter::kMean, 0).grid, grid);
  EXPECT_EQ(LevelOf(grid, ScalarType::kInt8, LevelFilter::kMean, 0).value_scale, 1);
}

TEST(VolumeLevelTest, OddLastPlanesAreLeftOut) {
  EXPECT_EQ(LevelDims({9, 8, 7}, 1), (math::Index3{4, 4, 3}));
  EXPECT_EQ(LevelDims({9, 8, 7}, 2), (math::Index3{2, 2, 1}));
  EXPECT_EQ(HighestLevel({9, 8, 7}), 1);
  EXPECT_EQ(HighestLevel({9, 8, 3}), 0);
  EXPECT_EQ(HighestLevel({1 << 24, 1 << 24, 1 << 24}), kMaxLevel);
}

TEST(VolumeLevelTest, AutoGoesFrom512DownToAbout64) {
  EXPECT_EQ(AutoHighestLevel({511, 512, 512}), 0);
  EXPECT_EQ(AutoHighestLevel({512, 512, 512}), 3);
  EXPECT_EQ(AutoHighestLevel({1000, 1000, 1000}), 4);
  EXPECT_EQ(AutoHighestLevel({1024, 1024, 1024}), 4);
  EXPECT_EQ(AutoHighestLevel({2560, 2560, 2560}), 5);
  // A thin volume keeps kMinAutoEdge samples.
  EXPECT_EQ(AutoHighestLevel({20000, 20000, 40}), 1);
  EXPECT_EQ(AutoHighestLevel({20000, 20000, 4}), 0);
  // The product does not overflow.
  EXPECT_GT(AutoHighestLevel({1 << 24, 1 << 24, 1 << 13}), 8);
}

TEST(VolumeLevelTest, TypesAndScalesFollowTheFilter) {
  EXPECT_EQ(LevelType(ScalarType::kUint8, LevelFilter::kMean), ScalarType::kUint16);
  EXPECT_EQ(LevelType(ScalarType::kUint8, LevelFilter::kMajority), ScalarType::kUint8);
  EXPECT_EQ(LevelValueScale(ScalarType::kUint8, LevelFilter::kMajority), 1);
  for (const ScalarType type : {ScalarType::kUint16, ScalarType::kInt32, ScalarType::kFloat32}) {
    EXPECT_EQ(LevelType(type, LevelFilter::kMean), type);
    EXPECT_EQ(LevelValueScale(type, LevelFilter::kMean), 1);
  }
  EXPECT_TRUE(CanFilter(LevelFilter::kMean, ScalarType::kFloat64));
  EXPECT_TRUE(CanFilter(LevelFilter::kMajority, ScalarType::kInt32));
  EXPECT_FALSE(CanFilter(LevelFilter::kMajority, ScalarType::kFloat64));
}

TEST(VolumeLevelTest, FiltersHaveNames) {
  for (const LevelFilter filter : {LevelFilter::kMean, LevelFilter::kMajority}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LevelFilter found, LevelFilterFromName(NameOf(filter)));
    EXPECT_EQ(found, filter);
  }
  EXPECT_THAT(LevelFilterFromName("median"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("expected mean or majority")));
}

}  // namespace
}  // namespace isoscope::volume
