// A volume and its first level, each partitioned as a volume of its own: which blocks of level 0
// the level's shards resolve, together and apart.

#include "partition-agent/supply/level_resolution.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_format.h"
#include "core/volume/resolved_blocks.h"
#include "partition-agent/memory/agent_metrics.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::agent {
namespace {

using volume::InsideRule;

constexpr math::Index3 kDims{34, 30, 27};

// Small balls and lone voxels, as float32 [z][y][x].
std::vector<float> FineSamples() {
  std::vector<float> samples(static_cast<std::size_t>(math::Volume(kDims)));
  for (std::int64_t i = 0; i < math::Volume(kDims); ++i) {
    const std::int64_t x = i % kDims.x;
    const std::int64_t y = i / kDims.x % kDims.y;
    const std::int64_t z = i / (kDims.x * kDims.y);
    const bool is_ball = (x - 8) * (x - 8) + (y - 9) * (y - 9) + (z - 10) * (z - 10) < 30;
    const bool is_lone = base::RandomUnit(4, static_cast<std::uint64_t>(i)) < 0.001;
    samples[static_cast<std::size_t>(i)] = is_ball || is_lone ? 100.0F : 0.0F;
  }
  return samples;
}

std::vector<float> Halved(const std::vector<float>& fine, const math::Index3& dims) {
  std::vector<float> coarse;
  for (std::int64_t z = 0; z < kDims.z / 2; ++z) {
    for (std::int64_t y = 0; y < kDims.y / 2; ++y) {
      for (std::int64_t x = 0; x < kDims.x / 2; ++x) {
        float sum = 0;
        for (std::int64_t k = 0; k < 8; ++k) {
          sum += fine[static_cast<std::size_t>(
              2 * x + (k & 1) + dims.x * (2 * y + (k >> 1 & 1) + dims.y * (2 * z + (k >> 2))))];
        }
        coarse.push_back(sum / 8);
      }
    }
  }
  return coarse;
}

class LevelResolutionTest : public ::testing::Test {
 protected:
  Shards Cut(const math::Index3& dims, const std::vector<float>& samples, std::int64_t edge,
             int shard_count) {
    std::string bytes;
    for (const float sample : samples) {
      base::AppendLittleEndian(sample, &bytes);
    }
    volume::GridGeometry geometry;
    geometry.sample_dims = dims;
    const auto source =
        testing::MakeMemorySource(geometry, volume::ScalarType::kFloat32, bytes, "cut");
    partition::PartitionOptions options;
    options.output_directory = temp_.Sub(absl::StrCat("cut", ++count_));
    options.shard_count = shard_count;
    options.block_cells = {edge, edge, edge};
    ISOSCOPE_CHECK(partition::Partition(*source, options, never_).ok());
    Shards shards;
    for (int i = 0; i < shard_count; ++i) {
      shards.push_back(
          OpenShard(options.output_directory + "/" + store::ShardDirectoryName(i, shard_count))
              .value());
    }
    return shards;
  }

  base::TaskArena arena_{2};
  BlockCache cache_{std::size_t{1} << 24};
  AgentMetrics metrics_;
  const base::Cancellation never_;
  testing::TempDir temp_;
  int count_ = 0;
};

TEST_F(LevelResolutionTest, TheUnionOfAnyShardsIsThatOfAllCells) {
  const std::vector<float> fine_samples = FineSamples();
  const std::vector<float> coarse_samples = Halved(fine_samples, kDims);
  const math::Index3 coarse_dims{kDims.x / 2, kDims.y / 2, kDims.z / 2};
  const InsideRule rule = InsideRule::OfIsovalue(60);
  const Shards fine = Cut(kDims, fine_samples, 4, 1);
  const store::ShardReader& reader = *fine.front()->reader;
  const volume::BlockTree active(reader.layout().block_dims(), reader.ranges().ActiveBlocks(rule));
  const LevelPair pair{.fine = &reader.layout(), .fine_active = &active, .level = 1};
  // By brute force.
  volume::ResolvedBlocks all(reader.layout(), &active, 1);
  const auto at = [&](std::int64_t x, std::int64_t y, std::int64_t z) {
    return coarse_samples[static_cast<std::size_t>(x + coarse_dims.x * (y + coarse_dims.y * z))];
  };
  for (std::int64_t z = 0; z + 1 < coarse_dims.z; ++z) {
    for (std::int64_t y = 0; y + 1 < coarse_dims.y; ++y) {
      for (std::int64_t x = 0; x + 1 < coarse_dims.x; ++x) {
        int inside = 0;
        for (std::int64_t k = 0; k < 8; ++k) {
          inside += at(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)) >= 60 ? 1 : 0;
        }
        if (inside > 0 && inside < 8) {
          all.AddCell({x, y, z});
        }
      }
    }
  }
  const std::vector<volume::BlockId> expected = all.Ids();
  EXPECT_GT(expected.size(), 5U);
  EXPECT_GT(active.count(), static_cast<std::int64_t>(expected.size()) + 5)
      << "lone voxels are gone at level 1";
  for (const int shard_count : {1, 3}) {
    for (const std::int64_t edge : {3, 8}) {
      volume::BlockSet found(reader.layout().block_count());
      for (const std::shared_ptr<const Shard>& shard :
           Cut(coarse_dims, coarse_samples, edge, shard_count)) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            const std::vector<volume::BlockId> of_shard,
            BlocksResolvedBy({shard}, rule, pair,
                             {.arena = &arena_, .cache = &cache_, .metrics = &metrics_}, never_));
        found.InsertAll(of_shard);
      }
      EXPECT_EQ(found.Ids(), expected) << shard_count << " shards, blocks of " << edge;
    }
  }
}

TEST_F(LevelResolutionTest, WithoutActiveBlocksNothingIsRead) {
  const std::vector<float> fine_samples = FineSamples();
  const math::Index3 coarse_dims{kDims.x / 2, kDims.y / 2, kDims.z / 2};
  const Shards coarse = Cut(coarse_dims, Halved(fine_samples, kDims), 4, 1);
  const auto layout = volume::BlockLayout::Make(kDims, {4, 4, 4}).value();
  const volume::BlockTree none(layout.block_dims(), volume::BlockSet(layout.block_count()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<volume::BlockId> resolved,
      BlocksResolvedBy(coarse, InsideRule::OfIsovalue(60),
                       {.fine = &layout, .fine_active = &none, .level = 1},
                       {.arena = &arena_, .cache = &cache_, .metrics = &metrics_}, never_));
  EXPECT_TRUE(resolved.empty());
  EXPECT_EQ(metrics_.read_bytes.value(), 0);
}

TEST_F(LevelResolutionTest, ACancelledQuestionEnds) {
  const std::vector<float> fine_samples = FineSamples();
  const Shards fine = Cut(kDims, fine_samples, 4, 1);
  const Shards coarse =
      Cut({kDims.x / 2, kDims.y / 2, kDims.z / 2}, Halved(fine_samples, kDims), 4, 1);
  const InsideRule rule = InsideRule::OfIsovalue(60);
  const volume::BlockTree active(fine.front()->reader->layout().block_dims(),
                                 fine.front()->reader->ranges().ActiveBlocks(rule));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_TRUE(absl::IsCancelled(
      BlocksResolvedBy(
          coarse, rule,
          {.fine = &fine.front()->reader->layout(), .fine_active = &active, .level = 1},
          {.arena = &arena_, .cache = &cache_, .metrics = &metrics_}, cancelled)
          .status()));
}

}  // namespace
}  // namespace isoscope::agent
