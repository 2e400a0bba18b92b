// The box is compared with brute force over the samples, for any number of shards, regions and cuts;
// and only few blocks are read.

#include "partition-agent/supply/cell_box.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/extract/active_cells.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_source.h"
#include "core/store/block_overhang.h"
#include "core/store/sample_reader.h"
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

constexpr std::int64_t kUnitEdge = 32;

// Bytes [z][y][x] that are read in units, in any order.
class UnitSource final : public source::VolumeSource {
 public:
  UnitSource(const volume::GridGeometry& geometry, std::string samples)
      : VolumeSource({.name = "units", .geometry = geometry, .type = ScalarType::kUint8}),
        samples_(std::move(samples)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t row_bytes = info().row_bytes();
    std::copy_n(samples_.data() + begin_row * row_bytes, (end_row - begin_row) * row_bytes, out);
    return absl::OkStatus();
  }
  [[nodiscard]] std::optional<source::BoxGrid> box_grid() const override {
    return source::BoxGrid{.box_dims = {kUnitEdge, kUnitEdge, kUnitEdge}};
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& /*cancellation*/) const override {
    const math::Index3& dims = info().geometry.sample_dims;
    for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
      for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
        out = std::copy_n(samples_.data() + (z * dims.y + y) * dims.x + box.begin.x, box.dims().x,
                          out);
      }
    }
    return absl::OkStatus();
  }

 private:
  const std::string samples_;
};

// Reads blocks from that source. Counts rounds of reads, before each of which units are looked for,
// and the units that they need.
class CountedRounds final : public store::SampleReader {
 public:
  CountedRounds(const source::VolumeSource* source, const store::Manifest& manifest, bool is_local)
      : source_(*source),
        layout_(
            volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells).value()),
        in_source_(*manifest.in_source),
        is_local_(is_local) {}

  [[nodiscard]] absl::Status ReadBlock(volume::BlockId id, const base::Cancellation& cancellation,
                                       char* out) const override {
    const math::IndexBox part = store::PartInUnit(layout_, in_source_, id);
    const math::IndexBox stored = layout_.StoredSamplesOf(id);
    for (std::int64_t z = part.begin.z; z < part.end.z; ++z) {
      for (std::int64_t y = part.begin.y; y < part.end.y; ++y) {
        char* const row =
            out + ((z - stored.begin.z) * stored.dims().y + y - stored.begin.y) * stored.dims().x +
            part.begin.x - stored.begin.x;
        ISOSCOPE_RETURN_IF_ERROR(source_.ReadBox(
            {.begin = {part.begin.x, y, z}, .end = {part.end.x, y + 1, z + 1}}, row, cancellation));
      }
    }
    Note(UnitOf(id));
    return absl::OkStatus();
  }
  [[nodiscard]] math::Index3 UnitOf(volume::BlockId id) const override {
    return store::UnitOfBlock(layout_, in_source_, id);
  }
  [[nodiscard]] absl::Status ReadUnit(const math::Index3& unit,
                                      const base::Cancellation& /*cancellation*/) const override {
    Note(unit);
    return absl::OkStatus();
  }
  [[nodiscard]] absl::Status Doubt(volume::BlockId /*id*/) const override {
    return absl::OkStatus();
  }
  [[nodiscard]] bool HasUnit(const math::Index3& /*unit*/) const override {
    const base::MutexLock lock(&mutex_);
    round_count_ += std::exchange(is_new_, false) ? 1 : 0;
    return false;
  }
  [[nodiscard]] std::size_t max_units_ahead() const override { return 4; }
  [[nodiscard]] const std::string& name() const override { return in_source_.request.at("path"); }
  [[nodiscard]] bool is_local() const override { return is_local_; }

  [[nodiscard]] int round_count() const {
    const base::MutexLock lock(&mutex_);
    return round_count_;
  }
  [[nodiscard]] std::size_t unit_count() const {
    const base::MutexLock lock(&mutex_);
    return units_.size();
  }

 private:
  void Note(const math::Index3& unit) const {
    const base::MutexLock lock(&mutex_);
    is_new_ = true;
    units_.insert({unit.x, unit.y, unit.z});
  }

  const source::VolumeSource& source_;
  const volume::BlockLayout layout_;
  const store::SourceSamples in_source_;
  const bool is_local_;
  mutable base::Mutex mutex_;
  mutable bool is_new_ ABSL_GUARDED_BY(mutex_) =
      true;  // no unit was looked for since the last read
  mutable int round_count_ ABSL_GUARDED_BY(mutex_) = 0;
  mutable std::set<std::array<std::int64_t, 3>> units_ ABSL_GUARDED_BY(mutex_);
};

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

// Each round of a far source is a round trip. Without counting units it takes as many as a local one.
TEST_F(CellBoxTest, AFarSourceTakesFewRoundsAndNoMoreUnits) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {125, 125, 125};
  const std::string samples = testing::SampleField(testing::SphereField(0.55), geometry.sample_dims,
                                                   ScalarType::kUint8, 100, 100);
  const UnitSource source(geometry, samples);
  partition::PartitionOptions options;
  options.output_directory = temp_.Sub("units");
  options.block_cells = {2, 2, 2};
  options.in_source.emplace().request["path"] = "units";
  UnitSource to_cut(geometry, samples);
  ISOSCOPE_ASSERT_OK(partition::Partition(to_cut, options, never_));
  std::vector<std::shared_ptr<const CountedRounds>> readers;
  for (const bool is_local : {true, false}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::shared_ptr<const Shard> shard,
        OpenShard(
            options.output_directory + "/" + store::ShardDirectoryName(0, 1), NextShardNumber(),
            io::OpenRandomAccessFile, [&](const store::Manifest& manifest) {
              readers.push_back(std::make_shared<const CountedRounds>(&source, manifest, is_local));
              return absl::StatusOr<std::shared_ptr<const store::SampleReader>>(readers.back());
            }));
    const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(100)};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const math::IndexBox found, Find({shard}, rules));
    EXPECT_EQ(found, BruteForce(geometry.sample_dims, ScalarType::kUint8, samples, rules, {}));
  }
  ASSERT_EQ(readers.size(), 2U);
  EXPECT_GE(readers[0]->round_count(), 3);
  EXPECT_EQ(readers[1]->round_count(), 1);
  EXPECT_LE(readers[1]->unit_count(), readers[0]->unit_count());
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
