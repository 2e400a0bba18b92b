#include "partition-agent/supply/color_volumes.h"

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"
#include "core/base/task_arena.h"
#include "core/extract/block_extractor.h"
#include "partition-agent/supply/mesh_supply.h"
#include "tests/support/block_cutter.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::testing::HasSubstr;
using testing::SmallDataset;
using testing::StatusIs;
using volume::ScalarType;

constexpr int kShardCount = 3;
constexpr std::size_t kAmple = std::size_t{1} << 30;

// Another field on the grid of a SmallDataset.
struct OtherField {
  ScalarType type = ScalarType::kUint8;
  std::string samples;
  Shards shards;
};

class ColorVolumesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const math::Index3& dims = drawn_.geometry().sample_dims;
    fields_[0] = {
        ScalarType::kFloat32,
        testing::SampleField(testing::RandomField(5, 20, 8), dims, ScalarType::kFloat32, 3, 0),
        {}};
    fields_[1] = {
        ScalarType::kFloat64, testing::SampleNoise(3, dims, ScalarType::kFloat64, 50), {}};
    for (OtherField& field : fields_) {
      field.shards = OpenOf(dims, field.type, field.samples);
    }
    shards_ = drawn_.OpenShards();
  }

  // Partitions and opens a volume.
  Shards OpenOf(const math::Index3& dims, ScalarType type, const std::string& samples,
                const partition::PartitionOptions& given = {}) {
    volume::GridGeometry geometry;
    geometry.sample_dims = dims;
    partition::PartitionOptions options = given;
    options.output_directory = temp_.Sub(absl::StrCat("field", ++count_));
    options.shard_count = given.shard_count > 1 ? given.shard_count : kShardCount;
    if (options.block_cells == math::Index3{}) {
      options.block_cells = {8, 8, 8};
    }
    const auto source = testing::MakeMemorySource(geometry, type, samples, "field");
    ISOSCOPE_CHECK(partition::Partition(*source, options, never_).ok());
    Shards shards;
    for (int i = 0; i < kShardCount && i < options.shard_count; ++i) {
      auto shard = OpenShard(options.output_directory + "/" +
                             store::ShardDirectoryName(i, options.shard_count));
      ISOSCOPE_CHECK(shard.ok());
      shards.push_back(*std::move(shard));
    }
    return shards;
  }

  std::string SamplesOfBlock(const OtherField& field, volume::BlockId id) const {
    return testing::CutBlock(drawn_.layout(), field.type, field.samples, id);
  }

  const SmallDataset drawn_{kShardCount};
  testing::TempDir temp_;
  int count_ = 0;
  std::array<OtherField, 2> fields_;
  Shards shards_;
  const base::Cancellation never_;
};

TEST_F(ColorVolumesTest, VolumesAreCountedOnceHoweverManySurfacesShowThem) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ColorVolumes colors,
      ColorVolumes::Make(shards_, {{}, fields_[1].shards, fields_[0].shards, fields_[1].shards}));
  EXPECT_EQ(colors.volume_count(), 2U);
  EXPECT_EQ(colors.VolumeOf(0), std::nullopt);
  EXPECT_EQ(colors.VolumeOf(1), colors.VolumeOf(3));
  EXPECT_EQ(colors.VolumeOf(9), std::nullopt);
  EXPECT_EQ(colors.ShardOf(2, 0), nullptr);
  EXPECT_EQ(colors.ShardOf(2, 2), fields_[0].shards[2].get());
  EXPECT_EQ(colors.ShardOf(1, 3), fields_[1].shards[1].get());
  EXPECT_TRUE(ColorVolumes().empty());
  EXPECT_EQ(ColorVolumes().ShardOf(0, 0), nullptr);
}

TEST_F(ColorVolumesTest, AVolumeThatIsCutInAnotherWayIsNamedWithBothValues) {
  const math::Index3 dims = drawn_.geometry().sample_dims;
  const math::Index3 larger{dims.x + 1, dims.y, dims.z};
  const auto noise = [](const math::Index3& of) {
    return testing::SampleNoise(1, of, ScalarType::kUint8, 200);
  };
  const Shards other_dims = OpenOf(larger, ScalarType::kUint8, noise(larger));
  EXPECT_THAT(ColorVolumes::Make(shards_, {other_dims}).status(),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("has 41 x 37 x 33 samples, dataset id " +
                                 other_dims[0]->reader->manifest().dataset_id +
                                 " whose samples colour its surfaces has 42 x 37 x 33 samples")));
  partition::PartitionOptions options;
  options.block_cells = {8, 9, 8};
  EXPECT_THAT(
      ColorVolumes::Make(shards_, {{}, OpenOf(dims, ScalarType::kUint8, noise(dims), options)})
          .status(),
      StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("blocks of 8 x 9 x 8 cells")));
  options.block_cells = {8, 8, 8};
  options.shard_count = 4;
  EXPECT_THAT(ColorVolumes::Make(shards_, {OpenOf(dims, ScalarType::kUint8, noise(dims), options)})
                  .status(),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("in shard 0 of 4")));
}

// Two blocks in two shards: some seeds deal them out the other way round.
TEST_F(ColorVolumesTest, ABlockThatLiesInAnotherShardIsNamed) {
  const math::Index3 dims{17, 9, 9};
  const auto open = [&](std::uint64_t seed) {
    partition::PartitionOptions options;
    options.shard_count = 2;
    options.seed = seed;
    return OpenOf(dims, ScalarType::kUint8,
                  testing::SampleNoise(seed, dims, ScalarType::kUint8, 200), options);
  };
  const Shards drawn = open(1);
  std::set<absl::StatusCode> codes;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ColorVolumes colors,
                                  ColorVolumes::Make(drawn, {open(seed)}));
    const absl::Status status = colors.CheckBlock(1, 0, drawn[1]->reader->block_id(0));
    codes.insert(status.code());
    if (!status.ok()) {
      EXPECT_THAT(std::string(status.message()),
                  HasSubstr("both must be cut alike, with one seed"));
    }
  }
  EXPECT_EQ(codes, (std::set{absl::StatusCode::kOk, absl::StatusCode::kFailedPrecondition}));
}

TEST_F(ColorVolumesTest, EachBlockIsVisitedOnceWithItsSamplesWithinAnyLimit) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ColorVolumes colors,
      ColorVolumes::Make(shards_, {fields_[0].shards, {}, fields_[1].shards}));
  std::vector<ColoredBlock> blocks;
  for (std::uint32_t shard = 0; shard < kShardCount; ++shard) {
    const auto count = static_cast<std::uint32_t>(shards_[shard]->reader->block_count());
    for (std::uint32_t ordinal = shard; ordinal < count; ordinal += 1 + ordinal % 3) {
      blocks.push_back({{shard, ordinal}, (ordinal * 7 + shard) % 4});
    }
  }
  std::int64_t bytes_of_first = 0;
  for (const int threads : {1, 3}) {
    const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(threads);
    for (const std::size_t max_read_bytes : {std::size_t{1}, std::size_t{60'000}, kAmple}) {
      for (const std::size_t cache_bytes : {std::size_t{0}, std::size_t{1} << 20, kAmple}) {
        SCOPED_TRACE(absl::StrCat(threads, " threads, ", max_read_bytes, " bytes to read, ",
                                  cache_bytes, " of cache"));
        BlockCache cache(cache_bytes);
        for (int turn = 0; turn < 3; ++turn) {
          cache.BeginRound(turn);
          base::Mutex mutex;
          std::vector<int> visits(blocks.size(), 0);
          const auto read_bytes = VisitColoredBlocks(
              shards_, colors, blocks,
              {.arena = arena.get(), .cache = &cache, .max_read_bytes = max_read_bytes}, never_,
              [&](std::size_t i, const volume::BlockSamples& samples,
                  std::span<const volume::BlockSamples> fields) {
                const base::MutexLock lock(&mutex);
                ++visits[i];
                EXPECT_EQ(fields.size(), 2U);
                for (std::size_t volume = 0; volume < 2; ++volume) {
                  if (!blocks[i].volumes.test(volume)) {
                    EXPECT_EQ(fields[volume].bytes, nullptr);
                    continue;
                  }
                  const std::string expected = SamplesOfBlock(fields_[volume], samples.block_id);
                  EXPECT_EQ(fields[volume].block_id, samples.block_id);
                  EXPECT_EQ(fields[volume].type, fields_[volume].type);
                  EXPECT_EQ(std::string(fields[volume].bytes, expected.size()), expected);
                }
                return absl::OkStatus();
              });
          ISOSCOPE_ASSERT_OK(read_bytes.status());
          EXPECT_EQ(visits, std::vector<int>(blocks.size(), 1));
          bytes_of_first = turn == 0 && cache_bytes == 0 && max_read_bytes == kAmple
                               ? *read_bytes
                               : bytes_of_first;
          if (turn == 2 && cache_bytes == kAmple && max_read_bytes == kAmple) {
            EXPECT_LT(*read_bytes, bytes_of_first / 2) << "the cache has the samples of the fields";
          }
        }
      }
    }
  }
}

TEST_F(ColorVolumesTest, AnErrorOfTheVisitAndACancellationEndIt) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ColorVolumes colors,
                                ColorVolumes::Make(shards_, {fields_[0].shards}));
  const std::vector<ColoredBlock> blocks = {{{0, 0}, 1}, {{0, 1}, 1}};
  const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(2);
  BlockCache cache(kAmple);
  const AgentResources resources{.arena = arena.get(), .cache = &cache};
  const auto visit = [](std::size_t, const volume::BlockSamples&,
                        std::span<const volume::BlockSamples>) {
    return absl::InternalError("no more");
  };
  EXPECT_THAT(VisitColoredBlocks(shards_, colors, blocks, resources, never_, visit).status(),
              StatusIs(absl::StatusCode::kInternal));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(VisitColoredBlocks(shards_, colors, blocks, resources, cancelled, visit).status(),
              StatusIs(absl::StatusCode::kCancelled));
}

// Keeps the values of all meshes, by surface and block. Full after every `capacity` batches.
class ValuesSink final : public MeshSink {
 public:
  explicit ValuesSink(int capacity) : capacity_(capacity) {}

  absl::Status Add(std::span<const render::MeshToDraw> meshes) override {
    const base::MutexLock lock(&mutex_);
    ++held_;
    for (const render::MeshToDraw& item : meshes) {
      std::vector<double>& to = values_[{item.surface_index, item.mesh->block_id}];
      for (std::size_t v = 0; v < item.mesh->values.size(); ++v) {
        to.push_back(item.mesh->values[v]);
      }
    }
    return absl::OkStatus();
  }
  [[nodiscard]] bool is_full() const override {
    const base::MutexLock lock(&mutex_);
    return held_ >= capacity_;
  }
  absl::Status Drain() override {
    const base::MutexLock lock(&mutex_);
    held_ = 0;
    return absl::OkStatus();
  }

  using Values = std::map<std::pair<std::uint32_t, volume::BlockId>, std::vector<double>>;
  Values Take() {
    const base::MutexLock lock(&mutex_);
    return std::move(values_);
  }

 private:
  const int capacity_;
  mutable base::Mutex mutex_;
  int held_ ABSL_GUARDED_BY(mutex_) = 0;
  Values values_ ABSL_GUARDED_BY(mutex_);
};

// Frames that take turns with the colours of one surface, on one cache.
TEST_F(ColorVolumesTest, MeshesHaveTheValuesOfTheirFieldWhateverWasKept) {
  const std::vector<double> isovalues = {SmallDataset::kIsovalue, 140, SmallDataset::kIsovalue,
                                         SmallDataset::kIsovalue};
  const std::vector<bool> by_gradient = {false, false, true, false};
  extract::BlockExtractor extractor(drawn_.geometry(), drawn_.layout());
  const auto expected_of = [&](std::uint32_t surface, volume::BlockId id,
                               std::optional<std::size_t> color) {
    const std::string drawn =
        testing::CutBlock(drawn_.layout(), ScalarType::kUint8, drawn_.samples(), id);
    const volume::BlockSamples samples{id, ScalarType::kUint8, drawn.data()};
    mesh::VertexValues values;
    std::string bytes;
    if (color.has_value()) {
      bytes = SamplesOfBlock(fields_[*color], id);
      values = extractor
                   .ExtractWithField(samples, isovalues[surface],
                                     {id, fields_[*color].type, bytes.data()})
                   .values;
    } else {
      values = extractor.Extract(samples, isovalues[surface], by_gradient[surface]).values;
    }
    std::vector<double> copy;
    for (std::size_t v = 0; v < values.size(); ++v) {
      copy.push_back(values[v]);
    }
    return copy;
  };
  std::vector<volume::InsideRule> rules;
  for (const double isovalue : isovalues) {
    rules.push_back(volume::InsideRule::OfIsovalue(isovalue));
  }
  IndexCost cost;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SurfaceBlocks blocks,
                                SurfaceBlocks::Find(shards_, rules, nullptr, never_, &cost));
  std::int64_t frame_number = 0;
  for (const std::size_t cache_bytes : {std::size_t{0}, std::size_t{3} << 20, kAmple}) {
    BlockCache cache(cache_bytes);
    for (const int threads : {3, 1}) {
      const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(threads);
      for (const std::size_t max_read_bytes : {std::size_t{1}, std::size_t{100'000}, kAmple}) {
        for (const std::size_t color : {0U, 1U, 0U}) {
          SCOPED_TRACE(absl::StrCat(threads, " threads, ", max_read_bytes, " bytes to read, ",
                                    cache_bytes, " of cache, field ", color));
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(
              ColorVolumes colors,
              ColorVolumes::Make(shards_, {fields_[color].shards, fields_[0].shards, {}, {}}));
          MeshSupply supply(
              &blocks, cache.BeginRound(++frame_number),
              {.arena = arena.get(), .cache = &cache, .max_read_bytes = max_read_bytes}, &never_,
              by_gradient, std::move(colors));
          ValuesSink sink(max_read_bytes == kAmple ? 1 << 30 : 2);
          ISOSCOPE_ASSERT_OK(supply.AddMeshes(blocks.ChooseAll(), &sink).status());
          std::size_t with_values = 0;
          for (const auto& [key, values] : sink.Take()) {
            const auto& [surface, id] = key;
            const std::optional<std::size_t> of_surface = surface == 0 ? std::optional(color)
                                                          : surface == 1
                                                              ? std::optional<std::size_t>(0)
                                                              : std::nullopt;
            ASSERT_EQ(values, expected_of(surface, id, of_surface)) << surface << ", block " << id;
            with_values += values.empty() ? 0U : 1U;
          }
          EXPECT_GT(with_values, 100U);
        }
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::agent
