// The box is compared with brute force over the samples, for any number of shards, regions and cuts;
// and only few blocks are read.

#include "partition-agent/supply/cell_box.h"

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/extract/active_cells.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_format.h"
#include "partition-agent/memory/agent_metrics.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using testing::SmallDataset;
using testing::StatusIs;
using volume::InsideRule;
using volume::ScalarType;

class CellBoxTest : public ::testing::Test {
 protected:
  absl::StatusOr<math::IndexBox> Find(const Shards& shards, const std::vector<InsideRule>& rules,
                                      const view::ClipRegion& clip = {}) {
    return CellBoxOfShards(shards, rules, clip,
                           {.arena = &arena_, .cache = &cache_, .metrics = &metrics_}, never_);
  }
  // The box around those of each shard alone, as of agents with one shard each.
  math::IndexBox FindApart(const Shards& shards, const std::vector<InsideRule>& rules,
                           const view::ClipRegion& clip = {}) {
    math::IndexBox box;
    for (const std::shared_ptr<const Shard>& shard : shards) {
      box.Add(Find({shard}, rules, clip).value());
    }
    return box;
  }

  Shards Cut(const math::Index3& dims, ScalarType type, const std::string& samples,
             std::int64_t edge, int shard_count) {
    volume::GridGeometry geometry;
    geometry.sample_dims = dims;
    const auto source = testing::MakeMemorySource(geometry, type, samples, "cut");
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

// The box from all samples, as one block.
math::IndexBox BruteForce(const math::Index3& dims, ScalarType type, const std::string& samples,
                          const std::vector<InsideRule>& rules, const view::ClipRegion& clip) {
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  const view::Clipper clipper(clip, geometry);
  const auto layout = volume::BlockLayout::Make(dims, {128, 128, 128}).value();
  return extract::BoxOfActiveCells(
      layout, {0, type, samples.data()}, rules, [&](const math::Index3& cell) {
        return clipper.SideOf(math::IndexBox{cell, cell + math::Index3{1, 1, 1}}) !=
               view::Clipper::Side::kOutside;
      });
}

std::vector<view::ClipRegion> Regions() {
  view::ClipRegion oblique;
  oblique.half_spaces.push_back({{1, 0.5, -0.25}, 20.3});
  view::ClipRegion box;
  box.box = math::Box3d{.min = {3.5, 9, 12}, .max = {11, 20.25, 30}};
  view::ClipRegion both = box;
  both.half_spaces.push_back({{0, -1, 0}, -15});
  view::ClipRegion nothing;
  nothing.half_spaces.push_back({{1, 0, 0}, 1000});
  return {{}, oblique, box, both, nothing};
}

TEST_F(CellBoxTest, IsThatOfAllSamplesForAnyCutAndRegion) {
  const math::Index3 dims{41, 37, 33};
  const std::string sphere =
      testing::SampleField(testing::SphereField(0.55), dims, ScalarType::kUint8, 100, 100);
  const std::vector<std::vector<InsideRule>> rules = {
      {InsideRule::OfIsovalue(100)},
      {InsideRule::OfIsovalue(140), InsideRule::OfIsovalue(120)},
      {InsideRule::OfLabels({110, 111, 112})},
      {InsideRule::OfIsovalue(250)}};
  for (const std::int64_t edge : {5, 8, 16}) {
    for (const int shard_count : {1, 3}) {
      const Shards shards = Cut(dims, ScalarType::kUint8, sphere, edge, shard_count);
      for (const std::vector<InsideRule>& rule : rules) {
        for (const view::ClipRegion& region : Regions()) {
          const math::IndexBox expected =
              BruteForce(dims, ScalarType::kUint8, sphere, rule, region);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const math::IndexBox found, Find(shards, rule, region));
          EXPECT_EQ(found, expected);
          EXPECT_EQ(FindApart(shards, rule, region), expected);
        }
      }
    }
  }
}

// Where blocks have no active cell because samples are missing, those behind them count.
TEST_F(CellBoxTest, BlocksThatOnlySeemActiveDoNotCount) {
  const math::Index3 dims{33, 33, 33};
  std::string samples;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) {
        const bool is_missing = (x + y + z) % 2 == 0 && (x < 9 || x > 20);
        base::AppendLittleEndian(is_missing ? std::numeric_limits<float>::quiet_NaN()
                                            : static_cast<float>((x * 7 + y * 5 + z * 3) % 11),
                                 &samples);
      }
    }
  }
  const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(5)};
  const math::IndexBox expected = BruteForce(dims, ScalarType::kFloat32, samples, rules, {});
  EXPECT_GT(expected.begin.x, 7);
  for (const int shard_count : {1, 4}) {
    const Shards shards = Cut(dims, ScalarType::kFloat32, samples, 4, shard_count);
    EXPECT_EQ(FindApart(shards, rules), expected);
  }
}

TEST_F(CellBoxTest, ASurfaceThatFillsTheVolumeCostsFewBlocks) {
  const SmallDataset dataset(1, {129, 129, 129});
  const Shards shards = dataset.OpenShards();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const math::IndexBox box,
                                Find(shards, {InsideRule::OfIsovalue(SmallDataset::kIsovalue)}));
  EXPECT_EQ(box, (math::IndexBox{{0, 0, 0}, {128, 128, 128}}));
  std::int64_t stored = 0;
  for (std::uint32_t ordinal = 0; ordinal < shards[0]->reader->block_count(); ++ordinal) {
    stored += shards[0]->reader->stored_bytes(ordinal);
  }
  EXPECT_LT(metrics_.read_bytes.value(), stored / 10);
}

TEST_F(CellBoxTest, WithoutAnActiveBlockNothingIsRead) {
  const SmallDataset dataset(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const math::IndexBox box,
                                Find(dataset.OpenShards(), {InsideRule::OfIsovalue(1e9)}));
  EXPECT_TRUE(box.empty());
  EXPECT_EQ(metrics_.reads.value(), 0);
}

TEST_F(CellBoxTest, ADamagedBlockAndACancelledCallAreErrors) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(SmallDataset::kIsovalue)};
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(CellBoxOfShards(shards, rules, {}, {.arena = &arena_, .cache = &cache_}, cancelled),
              StatusIs(absl::StatusCode::kCancelled));
  const std::string blocks = dataset.shard_directory(0) + "/" + store::kBlocksFileName;
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(blocks));
  for (std::int64_t offset = 0; offset < size; offset += 16) {
    testing::FlipBit(blocks, offset);
  }
  EXPECT_THAT(Find(shards, rules), StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::agent
