
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "google/protobuf/repeated_field.h"
#include "gtest/gtest.h"

#include "core/volume/volume_level.h"
#include "partition-agent/shard_set.h"
#include "tests/support/level_files.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::FlipBit;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

class ShardTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::string Path(int shard, const std::string& file) const {
    return dataset_.shard_directory(shard) + "/" + file;
  }

  const SmallDataset dataset_{3};
};

TEST_F(ShardTest, OpensBlocksAndTheirIndex) {
  std::int64_t block_count = 0;
  for (int i = 0; i < 3; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto shard, OpenShard(dataset_.shard_directory(i)));
    EXPECT_EQ(shard->reader->shard_index(), i);
    EXPECT_LE(shard->tree->interval_count(), shard->reader->block_count());
    block_count += shard->reader->block_count();
    // The tree and the spans that rays are cast through agree on what is active.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const index::QueryResult result,
                                  shard->tree->Query(SmallDataset::kIsovalue));
    EXPECT_FALSE(result.active.empty());
    const volume::BlockSet active = shard->reader->ranges().ActiveBlocks(SmallDataset::kIsovalue);
    for (const index::BlockInterval& interval : result.active) {
      EXPECT_TRUE(active.Contains(interval.block_id)) << interval.block_id;
    }
  }
  EXPECT_EQ(block_count, 5 * 5 * 4);
}

TEST_F(ShardTest, MissingFilesAreNamed) {
  EXPECT_THAT(OpenShard(dataset_.directory() + "/nothing"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("/nothing")));
  for (const char* name : {store::kIntervalTreeFileName, store::kBlocksFileName,
                           store::kBlockIndexFileName, store::kRangeTableFileName}) {
    const SmallDataset dataset(1);
    std::filesystem::remove(dataset.shard_directory(0) + "/" + name);
    const auto shard = OpenShard(dataset.shard_directory(0));
    EXPECT_FALSE(shard.ok()) << name;
    EXPECT_THAT(std::string(shard.status().message()), HasSubstr(name));
  }
}

TEST_F(ShardTest, FilesOfAnotherShardAreDataLoss) {
  for (const char* name : {store::kIntervalTreeFileName, store::kBlockIndexFileName}) {
    const SmallDataset dataset(2);
    std::filesystem::copy_file(dataset.shard_directory(0) + "/" + name,
                               dataset.shard_directory(1) + "/" + name,
                               std::filesystem::copy_options::overwrite_existing);
    ISOSCOPE_EXPECT_OK(OpenShard(dataset.shard_directory(0)));
    EXPECT_THAT(OpenShard(dataset.shard_directory(1)),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(name)));
  }
}

TEST_F(ShardTest, EveryTruncationOfTheTreeIsDataLoss) {
  const std::string path = Path(0, store::kIntervalTreeFileName);
  const auto full = static_cast<std::int64_t>(std::filesystem::file_size(path));
  ASSERT_GT(full, 100);
  for (std::int64_t size = full - 1; size >= 0; size -= size < 200 ? 1 : 97) {
    std::filesystem::resize_file(path, static_cast<std::uintmax_t>(size));
    EXPECT_THAT(OpenShard(dataset_.shard_directory(0)),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(store::kIntervalTreeFileName)))
        << size << " of " << full << " bytes";
  }
}

TEST_F(ShardTest, DamagedTreeHeaderIsDataLoss) {
  const std::string path = Path(1, store::kIntervalTreeFileName);
  for (std::int64_t offset = 0; offset < 64; ++offset) {
    FlipBit(path, offset);
    EXPECT_THAT(OpenShard(dataset_.shard_directory(1)),
                StatusIs(absl::StatusCode::kDataLoss,
                         AllOf(HasSubstr(store::kIntervalTreeFileName), HasSubstr("offset"))))
        << offset;
    FlipBit(path, offset);
  }
  ISOSCOPE_EXPECT_OK(OpenShard(dataset_.shard_directory(1)));
}

class LeveledShardTest : public ::testing::Test {
 protected:
  LeveledShardTest() {
    auto manifest = testing::AddLevelFiles(dataset_.directory(), dataset_.samples(), /*highest=*/2,
                                           volume::LevelFilter::kMean);
    EXPECT_TRUE(manifest.ok()) << manifest.status();
  }

  [[nodiscard]] std::string LevelFolder(int shard, int level) const {
    return absl::StrCat(dataset_.shard_directory(shard), "/level_", level);
  }
  [[nodiscard]] absl::StatusOr<LevelShards> Find(const ShardSet& set, int level) const {
    google::protobuf::RepeatedField<std::int32_t> indices;
    indices.Add(0);
    indices.Add(1);
    return set.FindLevel(dataset_.manifest().dataset_id, indices, level);
  }
  [[nodiscard]] Shards Open() const {
    Shards shards;
    for (int i = 0; i < 2; ++i) {
      auto shard = OpenShardWithLevels(dataset_.shard_directory(i));
      EXPECT_TRUE(shard.ok()) << shard.status();
      shards.push_back(*std::move(shard));
    }
    return shards;
  }

  const SmallDataset dataset_{2, {65, 57, 49}};
};

TEST_F(LeveledShardTest, LevelsAreShardsOfTheirOwn) {
  const ShardSet set(Open());
  for (int level = 0; level <= 2; ++level) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LevelShards found, Find(set, level));
    EXPECT_EQ(found.whole, dataset_.geometry());
    EXPECT_EQ(found.value_scale, level == 0 ? 1 : 256);
    ASSERT_EQ(found.shards.size(), 2U);
    for (std::size_t i = 0; i < 2; ++i) {
      const store::ShardReader& reader = *found.shards[i]->reader;
      EXPECT_EQ(reader.shard_index(), static_cast<int>(i));
      EXPECT_EQ(reader.manifest().geometry.sample_dims,
                (math::Index3{65 >> level, 57 >> level, 49 >> level}));
      EXPECT_EQ(reader.manifest().scalar_type,
                level == 0 ? volume::ScalarType::kUint8 : volume::ScalarType::kUint16);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const index::QueryResult result,
          found.shards[i]->tree->Query(SmallDataset::kIsovalue * found.value_scale));
      EXPECT_FALSE(result.active.empty());
    }
    // Caches keep blocks by number: a level never has that of another.
    EXPECT_NE(found.shards[0]->number, found.shards[1]->number);
  }
  EXPECT_THAT(Find(set, 3), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("level 3")));
}

// A shard without a level says so, and serves the rest.
TEST_F(LeveledShardTest, AMissingOrDamagedLevelLeavesTheOthers) {
  std::filesystem::remove_all(LevelFolder(1, 1));
  std::filesystem::resize_file(absl::StrCat(LevelFolder(0, 2), "/", store::kRangeTableFileName), 3);
  const Shards shards = Open();
  EXPECT_NE(shards[0]->levels[0], nullptr);
  EXPECT_EQ(shards[1]->levels[0], nullptr);
  EXPECT_EQ(shards[0]->levels[1], nullptr);
  const ShardSet set(shards);
  ISOSCOPE_EXPECT_OK(Find(set, 0));
  for (const int level : {1, 2}) {
    EXPECT_THAT(Find(set, level),
                StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("missing or damaged")));
  }
}

TEST_F(LeveledShardTest, ALevelOfAnotherDatasetIsLeftOut) {
  std::filesystem::remove_all(LevelFolder(0, 1));
  std::filesystem::copy(LevelFolder(1, 1), LevelFolder(0, 1),
                        std::filesystem::copy_options::recursive);
  EXPECT_EQ(Open()[0]->levels[0], nullptr);
}

}  // namespace
}  // namespace isoscope::agent
