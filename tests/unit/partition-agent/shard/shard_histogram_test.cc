#include "partition-agent/shard/shard_histogram.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/store/shard_writer.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::SmallDataset;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

volume::HistogramPart PartOf(const SmallDataset& dataset, std::int64_t max_bin_count,
                             const std::optional<volume::ScalarSpan>& range = std::nullopt) {
  // Shard by shard, as agents answer.
  std::optional<volume::HistogramPart> whole;
  for (const std::shared_ptr<const Shard>& shard : dataset.OpenShards()) {
    auto part = HistogramOfShards({shard}, max_bin_count, range);
    EXPECT_THAT(part.status(), testing::IsOk());
    if (!whole.has_value()) {
      whole = *part;
    } else {
      EXPECT_THAT(volume::AddPart(*part, &*whole), testing::IsOk());
    }
  }
  return *whole;
}

TEST(ShardHistogramTest, CostsAreThoseOfTheBlocksThatAreActiveAtTheCentres) {
  const SmallDataset dataset(3);
  const auto shards = dataset.OpenShards();
  for (const std::int64_t bins : {1, 7, 256, 4096}) {
    const volume::HistogramPart part = PartOf(dataset, bins);
    ASSERT_LE(part.groups.count, bins);
    for (std::int64_t g = 0; g < part.groups.count; ++g) {
      const double isovalue = part.groups.CenterOf(g);
      std::int64_t blocks = 0;
      std::int64_t bytes = 0;
      std::int64_t triangles = 0;
      for (const auto& shard : shards) {
        for (std::uint32_t i = 0; i < shard->reader->block_count(); ++i) {
          const volume::BlockId id = shard->reader->block_id(i);
          if (volume::IsActive(shard->reader->ranges().Get(id), isovalue)) {
            ++blocks;
            bytes += shard->reader->stored_bytes(i);
            triangles += volume::EstimateTriangles(dataset.layout().CellsOf(id).dims());
          }
        }
      }
      const auto at = static_cast<std::size_t>(g);
      ASSERT_EQ(part.active_block_counts[at], blocks) << isovalue;
      ASSERT_EQ(part.active_block_bytes[at], bytes) << isovalue;
      ASSERT_EQ(part.estimated_triangle_counts[at], triangles) << isovalue;
    }
  }
}

TEST(ShardHistogramTest, PartsAddUpToTheSameForAnyNumberOfShards) {
  const SmallDataset one(1);
  const SmallDataset three(3);
  for (const auto& range :
       {std::optional<volume::ScalarSpan>(), std::optional(volume::ScalarSpan{100, 150})}) {
    const volume::HistogramPart a = PartOf(one, 64, range);
    const volume::HistogramPart b = PartOf(three, 64, range);
    EXPECT_EQ(a.groups, b.groups);
    EXPECT_EQ(a.active_block_counts, b.active_block_counts);
    EXPECT_EQ(a.active_block_bytes, b.active_block_bytes);
    EXPECT_EQ(a.estimated_triangle_counts, b.estimated_triangle_counts);
    EXPECT_EQ(a.samples, b.samples);
    EXPECT_EQ(a.samples->TotalCount(), math::Volume(one.geometry().sample_dims));
    EXPECT_EQ(a.value_range, one.manifest().value_range);
    EXPECT_EQ(b.value_range, one.manifest().value_range);
  }
}

// As a dataset of an earlier version is: neither the file nor the members of shard.json.
void ForgetHistogram(const SmallDataset& dataset, int shard) {
  const std::string directory = dataset.shard_directory(shard);
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(directory + "/" + store::kHistogramFileName));
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(directory + "/" + store::kManifestFileName));
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(directory + "/" + store::kShardFileName));
  ISOSCOPE_ASSERT_OK(store::WriteDescriptions(directory, dataset.manifest(), shard));
}

TEST(ShardHistogramTest, WithoutTheFileTheRangesAnswerInTheSameBins) {
  const SmallDataset with(2);
  const SmallDataset without(2);
  ForgetHistogram(without, 0);
  ForgetHistogram(without, 1);
  const volume::HistogramPart a = PartOf(with, 100);
  const volume::HistogramPart b = PartOf(without, 100);
  EXPECT_FALSE(b.samples.has_value());
  EXPECT_EQ(a.groups, b.groups);
  EXPECT_EQ(a.active_block_counts, b.active_block_counts);
  EXPECT_EQ(a.estimated_triangle_counts, b.estimated_triangle_counts);
}

TEST(ShardHistogramTest, ADamagedFileAndARangeOutsideAreErrors) {
  const SmallDataset dataset(1);
  const auto shards = dataset.OpenShards();
  EXPECT_THAT(HistogramOfShards(shards, 8, volume::ScalarSpan{1000, 2000}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no sample is in it")));
  testing::FlipBit(dataset.shard_directory(0) + "/" + store::kHistogramFileName, -1);
  EXPECT_THAT(HistogramOfShards(shards, 8, std::nullopt),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr(store::kHistogramFileName)));
}

TEST(ActiveBoxTest, IsTheUnionOfTheActiveBlocksOfAllIsovalues) {
  const SmallDataset dataset(2);
  const auto shards = dataset.OpenShards();
  const volume::RangeTable& ranges = shards.front()->reader->ranges();
  const volume::BlockLayout layout = dataset.layout();
  for (const std::vector<double>& isovalues :
       {std::vector<double>{128}, {47.5}, {207.5}, {47.5, 207.5}, {-3}, {1e300}}) {
    std::int64_t count = 0;
    math::IndexBox expected{{1000, 1000, 1000}, {0, 0, 0}};
    for (std::int64_t i = 0; i < layout.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      if (std::any_of(isovalues.begin(), isovalues.end(),
                      [&](double v) { return volume::IsActive(ranges.Get(id), v); })) {
        ++count;
        for (int axis = 0; axis < 3; ++axis) {
          const math::IndexBox cells = layout.CellsOf(id);
          expected.begin[axis] = std::min(expected.begin[axis], cells.begin[axis]);
          expected.end[axis] = std::max(expected.end[axis], cells.end[axis]);
        }
      }
    }
    for (const auto& shard : shards) {
      std::vector<volume::InsideRule> rules;
      for (const double isovalue : isovalues) {
        rules.push_back(volume::InsideRule::OfIsovalue(isovalue));
      }
      const ActiveBox box = ActiveBoxOf(layout, shard->reader->ranges(), rules);
      EXPECT_EQ(box.block_count, count);
      if (count > 0) {
        EXPECT_EQ(box.cells, expected);
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ActiveBox by_tree,
                                    ActiveBoxOf(*shard->reader, rules, {}, 0));
      EXPECT_EQ(by_tree.block_count, box.block_count);
      EXPECT_EQ(by_tree.cells, box.cells);
    }
  }
}

TEST(ActiveBoxTest, BlocksOutsideOfTheClipRegionAreLeftOut) {
  const SmallDataset dataset(1);
  const auto shards = dataset.OpenShards();
  const volume::RangeTable& ranges = shards.front()->reader->ranges();
  const ActiveBox all = ActiveBoxOf(dataset.layout(), ranges, {{.isovalue = 128}});
  const std::int64_t layout_count = dataset.layout().block_count();
  const auto box_of = [&](const view::ClipRegion& clip) {
    const view::Clipper clipper(clip, dataset.geometry());
    const ActiveBox box = ActiveBoxOf(dataset.layout(), ranges, {{.isovalue = 128}}, clipper);
    for (const std::int64_t max_dense_blocks : {std::int64_t{0}, layout_count}) {
      const auto same =
          ActiveBoxOf(*shards.front()->reader, {{.isovalue = 128}}, clipper, max_dense_blocks);
      ISOSCOPE_EXPECT_OK(same);
      EXPECT_EQ(same->block_count, box.block_count);
      EXPECT_EQ(same->cells, box.cells);
    }
    return box;
  };
  // Blocks of 8 cells: those that reach x = 20 and z = 15.
  const ActiveBox some =
      box_of({.half_spaces = {{{1, 0, 0}, 20}}, .box = math::Box3d{{0, 0, 0}, {99, 99, 15}}});
  EXPECT_EQ(some.cells.begin, (math::Index3{16, all.cells.begin.y, all.cells.begin.z}));
  EXPECT_EQ(some.cells.end, (math::Index3{all.cells.end.x, all.cells.end.y, 16}));
  EXPECT_LT(some.block_count, all.block_count / 2);
  EXPECT_EQ(box_of({.half_spaces = {{{1, 0, 0}, 2000}}, .box = {}}).block_count, 0);
}

}  // namespace
}  // namespace isoscope::agent
