// Both distributions leave no shard empty. Beyond that:
//
// - Random: the shard of a block depends on seed and id alone; counts stay within the binomial
//   bound.
// - Greedy: active blocks are balanced better than by chance, at every isovalue; the result is
//   deterministic.
// - ShardMap gives the same shards as the two tables.

#include "core/partition/distribution.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/store/sample_reader.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"

namespace isoscope::partition {
namespace {

std::vector<std::int64_t> CountByShard(const std::vector<std::uint16_t>& shard_of_block,
                                       int shard_count) {
  std::vector<std::int64_t> counts(static_cast<std::size_t>(shard_count));
  for (const std::uint16_t shard : shard_of_block) {
    ++counts.at(shard);
  }
  return counts;
}

// Spans like those of a smooth volume: most narrow, a third constant.
volume::RangeTable MakeRanges(std::int64_t count, std::uint64_t seed) {
  volume::RangeTable ranges(volume::ScalarType::kUint16, count);
  for (std::int64_t i = 0; i < count; ++i) {
    const auto n = static_cast<std::uint64_t>(i);
    const double low = std::floor(60000 * base::RandomUnit(seed, 3 * n));
    const double width = base::RandomUnit(seed, 3 * n + 1) < 0.33
                             ? 0
                             : std::floor(5000 * std::pow(base::RandomUnit(seed, 3 * n + 2), 3));
    ranges.Set(static_cast<volume::BlockId>(i), {low, low + width});
  }
  return ranges;
}

// The largest, over isovalues, of (most active blocks in a shard) / (mean), where the mean is large
// enough to be balanced.
double WorstImbalance(const volume::RangeTable& ranges,
                      const std::vector<std::uint16_t>& shard_of_block, int shard_count) {
  double worst = 0;
  for (double isovalue = 100; isovalue < 65000; isovalue += 500) {
    std::vector<std::int64_t> active(static_cast<std::size_t>(shard_count));
    std::int64_t total = 0;
    for (std::int64_t i = 0; i < ranges.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      if (volume::IsActive(ranges.Get(id), isovalue)) {
        ++active[shard_of_block[id]];
        ++total;
      }
    }
    const double mean = static_cast<double>(total) / shard_count;
    if (mean >= 20) {
      worst = std::max(worst,
                       static_cast<double>(*std::max_element(active.begin(), active.end())) / mean);
    }
  }
  return worst;
}

TEST(ShardMapTest, SaysTheShardOfEveryBlockAsTheTablesDo) {
  for (const int shards : {1, 2, 7, 64}) {
    // With a block a shard, and two, some shards are empty at first: blocks are moved there.
    for (const std::int64_t blocks :
         {std::int64_t{shards}, std::int64_t{2} * shards, std::int64_t{1000}}) {
      const volume::RangeTable ranges = MakeRanges(blocks, 4);
      const ShardMap random = ShardMap::Random(blocks, shards, 9);
      const ShardMap greedy = ShardMap::Greedy(ranges, shards);
      EXPECT_EQ(random.shard_count(), shards);
      EXPECT_EQ(greedy.shard_count(), shards);
      const std::vector<std::uint16_t> random_table = DistributeRandomly(blocks, shards, 9);
      const std::vector<std::uint16_t> greedy_table = DistributeGreedily(ranges, shards);
      for (volume::BlockId id = 0; id < blocks; ++id) {
        ASSERT_EQ(random.ShardOf(id), random_table[id]) << shards << " " << blocks << " " << id;
        ASSERT_EQ(greedy.ShardOf(id), greedy_table[id]) << shards << " " << blocks << " " << id;
      }
    }
  }
}

TEST(ShardMapTest, MovesOnlyAsManyBlocksAsThereAreEmptyShards) {
  // As many shards, far more blocks: the same draws, of which none is moved.
  constexpr int kShards = 64;
  constexpr volume::BlockId kBlocks = 100;
  const ShardMap drawn = ShardMap::Random(100'000, kShards, 9);
  const ShardMap map = ShardMap::Random(kBlocks, kShards, 9);
  std::vector<std::int64_t> drawn_counts(kShards);
  std::vector<std::int64_t> counts(kShards);
  std::int64_t moved = 0;
  for (volume::BlockId id = 0; id < kBlocks; ++id) {
    ++drawn_counts[drawn.ShardOf(id)];
    ++counts[map.ShardOf(id)];
    moved += map.ShardOf(id) != drawn.ShardOf(id) ? 1 : 0;
  }
  EXPECT_EQ(moved, std::count(drawn_counts.begin(), drawn_counts.end(), 0));
  EXPECT_GT(moved, 0);
  EXPECT_THAT(counts, ::testing::Each(::testing::Ge(1)));
}

// Units by simple code: the unit of a block's first sample, numbered as they are met.
TEST(ShardMapTest, DealsOutUnits) {
  const auto layout = *volume::BlockLayout::Make({50, 40, 30}, {4, 8, 3});
  const store::SourceSamples samples{
      .request = {}, .unit_origin = {-3, 0, -1}, .unit_dims = {16, 8, 2}};
  const BlockUnits units(layout, samples);
  std::map<std::array<std::int64_t, 3>, std::uint32_t> known;  // z, y, x
  std::set<std::uint32_t> numbers;
  for (volume::BlockId id = 0; id < layout.block_count(); ++id) {
    const math::Index3 first = layout.CellsOf(id).begin;
    const std::array<std::int64_t, 3> unit = {(first.z + 1) / 2, first.y / 8, (first.x + 3) / 16};
    EXPECT_EQ(known.emplace(unit, units.UnitOf(id)).first->second, units.UnitOf(id));
    numbers.insert(units.UnitOf(id));
  }
  EXPECT_EQ(units.unit_count(), static_cast<std::int64_t>(known.size()));
  EXPECT_EQ(numbers.size(), known.size());
  EXPECT_EQ(*numbers.rbegin(), known.size() - 1);
  std::uint32_t next = 0;
  for (const auto& [unit, number] : known) {
    EXPECT_EQ(number, next++);
  }
  const auto shard_count = static_cast<int>(units.unit_count());
  for (const int shards : {1, 2, 7, shard_count}) {
    const ShardMap map = ShardMap::RandomUnits(units, shards, 9);
    const ShardMap of_units = ShardMap::Random(units.unit_count(), shards, 9);
    std::set<std::uint16_t> seen;
    for (volume::BlockId id = 0; id < layout.block_count(); ++id) {
      ASSERT_EQ(map.ShardOf(id), of_units.ShardOf(units.UnitOf(id)));
      seen.insert(map.ShardOf(id));
    }
    EXPECT_EQ(seen.size(), static_cast<std::size_t>(shards));
  }
}

TEST(DistributeRandomlyTest, ShardOfABlockDependsOnSeedAndIdOnly) {
  // No shard is empty here, so nothing was moved.
  const auto few = DistributeRandomly(1000, 4, 7);
  const auto many = DistributeRandomly(100000, 4, 7);
  EXPECT_TRUE(std::equal(few.begin(), few.end(), many.begin()));
  EXPECT_EQ(few, DistributeRandomly(1000, 4, 7));
  EXPECT_NE(few, DistributeRandomly(1000, 4, 8));
}

TEST(DistributeRandomlyTest, CountsStayWithinTheBinomialBound) {
  for (const int shards : {2, 3, 4, 16, 64}) {
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      const std::int64_t blocks = 32768;
      const double mean = static_cast<double>(blocks) / shards;
      const double sigma = std::sqrt(mean * (1 - 1.0 / shards));
      for (const std::int64_t count :
           CountByShard(DistributeRandomly(blocks, shards, seed), shards)) {
        EXPECT_NEAR(static_cast<double>(count), mean, 5 * sigma) << shards << " " << seed;
      }
    }
  }
}

TEST(DistributeRandomlyTest, IsNotAPatternOfTheId) {
  const auto shards = DistributeRandomly(10000, 2, 1);
  std::int64_t changes = 0;
  for (std::size_t i = 1; i < shards.size(); ++i) {
    changes += shards[i] != shards[i - 1] ? 1 : 0;
  }
  EXPECT_NEAR(static_cast<double>(changes), 5000, 250);  // 5 sigma
}

TEST(DistributeRandomlyTest, LeavesNoShardEmptyDownToOneBlockAShard) {
  for (const int shards : {1, 2, 5, 64, 1000, 65536}) {
    for (const std::int64_t blocks :
         {std::int64_t{shards}, std::int64_t{shards} + 1, std::int64_t{2} * shards}) {
      const auto counts = CountByShard(DistributeRandomly(blocks, shards, 9), shards);
      EXPECT_GE(*std::min_element(counts.begin(), counts.end()), 1) << shards << " " << blocks;
    }
  }
}

TEST(DistributeGreedilyTest, BalancesActiveBlocksBetterThanRandom) {
  const volume::RangeTable ranges = MakeRanges(60000, 5);
  for (const int shards : {2, 4, 16}) {
    const double greedy = WorstImbalance(ranges, DistributeGreedily(ranges, shards), shards);
    const double random =
        WorstImbalance(ranges, DistributeRandomly(ranges.block_count(), shards, 1), shards);
    EXPECT_LT(greedy, random) << shards;
    EXPECT_LT(greedy, 1.45) << shards;
    EXPECT_GE(greedy, 1.0) << shards;
  }
}

TEST(DistributeGreedilyTest, CountsDifferByFewBlocksAndTheResultIsTheSameTwice) {
  const volume::RangeTable ranges = MakeRanges(20000, 6);
  const auto shards = DistributeGreedily(ranges, 16);
  EXPECT_EQ(shards, DistributeGreedily(ranges, 16));
  const auto counts = CountByShard(shards, 16);
  EXPECT_LE(*std::max_element(counts.begin(), counts.end()) -
                *std::min_element(counts.begin(), counts.end()),
            1)
      << "a third of the blocks is never active and evens out the counts";
}

TEST(DistributeGreedilyTest, EqualBlocksAreDealtEvenly) {
  volume::RangeTable ranges(volume::ScalarType::kUint8, 10);
  for (volume::BlockId id = 0; id < 10; ++id) {
    ranges.Set(id, {10, 20});
  }
  EXPECT_THAT(CountByShard(DistributeGreedily(ranges, 4), 4),
              ::testing::UnorderedElementsAre(2, 2, 3, 3));
}

TEST(DistributeGreedilyTest, LeavesNoShardEmpty) {
  for (const int shards : {1, 7, 64, 2000}) {
    const volume::RangeTable ranges = MakeRanges(shards, 8);
    const auto counts = CountByShard(DistributeGreedily(ranges, shards), shards);
    EXPECT_EQ(*std::min_element(counts.begin(), counts.end()), 1) << shards;
  }
}

TEST(DistributeGreedilyTest, TakesEmptyConstantAndInfiniteSpans) {
  volume::RangeTable ranges(volume::ScalarType::kFloat64, 6);
  constexpr double kInf = std::numeric_limits<double>::infinity();
  constexpr double kMax = std::numeric_limits<double>::max();
  ranges.Set(1, {-kInf, kInf});
  ranges.Set(2, {-kMax, kMax});
  ranges.Set(3, {5, 5});
  ranges.Set(4, {0, kInf});
  const auto counts = CountByShard(DistributeGreedily(ranges, 3), 3);
  EXPECT_THAT(counts, ::testing::Each(2));
  EXPECT_THAT(
      CountByShard(DistributeGreedily(volume::RangeTable(volume::ScalarType::kFloat32, 9), 3), 3),
      ::testing::Each(3));
}

TEST(DistributeGreedilyTest, MillionBlocksOverSixteenShardsIsBalanced) {
  const volume::RangeTable ranges = MakeRanges(1000000, 3);
  const auto counts = CountByShard(DistributeGreedily(ranges, 16), 16);
  EXPECT_THAT(counts, ::testing::Each(62500));
}

}  // namespace
}  // namespace isoscope::partition
