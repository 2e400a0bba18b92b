// A shard with one level, made of the fixture's blocks. Levels that partitioning makes:
// tests/unit/core/partition/dataset_levels_test.cc.

#include "core/store/shard_levels.h"

#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::store {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class ShardLevelsTest : public ::testing::Test {
 protected:
  // Writes level 0, which names level 1, and level 1 in its folder. Returns the shard's folder.
  std::string MakeShard() {
    TestDataset base(volume::ScalarType::kUint8);
    TestDataset level(volume::ScalarType::kUint16);
    level.manifest.geometry = volume::LevelOf(base.manifest.geometry, volume::ScalarType::kUint8,
                                              volume::LevelFilter::kMean, 1)
                                  .grid;
    level.layout =
        volume::BlockLayout::Make(level.manifest.geometry.sample_dims, level.manifest.block_cells)
            .value();
    level.ranges = volume::RangeTable(volume::ScalarType::kUint16, level.layout.block_count());
    level.shard_of_block.assign(static_cast<std::size_t>(level.layout.block_count()), 0);
    level.blocks = BlocksByShard(level.layout, level.shard_of_block, 1);
    ISOSCOPE_EXPECT_OK(level.Write(dir_.Sub("level")));
    base.manifest.levels = {
        {.dataset_id = level.manifest.dataset_id,
         .manifest_crc32c = ManifestCrc32c(EncodeManifest(level.manifest), "level").value()}};
    ISOSCOPE_EXPECT_OK(base.Write(dir_.Sub("base")));
    std::string shard = dir_.Sub("base/shard-00000-of-00001");
    fs::rename(dir_.Sub("level/shard-00000-of-00001"), shard + "/level_1");
    return shard;
  }

  testing::TempDir dir_;
};

TEST_F(ShardLevelsTest, ALevelOpensAsAShardOfItsOwn) {
  const std::string shard = MakeShard();
  EXPECT_EQ(LevelDirectory(shard, 0), shard);
  EXPECT_EQ(LevelDirectory(shard, 12), shard + "/level_12");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto level0, OpenShardLevel(shard, 0));
  EXPECT_EQ(level0->manifest().highest_level(), 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto level1, OpenShardLevel(shard, 1));
  EXPECT_EQ(level1->manifest().geometry, level0->manifest().Level(1).grid);
  EXPECT_EQ(level1->manifest().scalar_type, volume::ScalarType::kUint16);
  EXPECT_EQ(level1->block_count(), 1);
  ISOSCOPE_EXPECT_OK(OpenLevelOf(*level0, 1).status());
  EXPECT_THAT(MissingLevels(shard, level0->manifest()), IsEmpty());
}

TEST_F(ShardLevelsTest, AMissingLevelIsNotFoundAndLevel0Opens) {
  const std::string shard = MakeShard();
  EXPECT_THAT(OpenShardLevel(shard, 2).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no level 2, only 0 to 1")));
  EXPECT_THAT(OpenShardLevel(shard, -1).status(), StatusIs(absl::StatusCode::kNotFound));
  fs::remove_all(shard + "/level_1");
  EXPECT_THAT(OpenShardLevel(shard, 1).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("shard 0 of 1 lacks level 1")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto level0, OpenShardLevel(shard, 0));
  EXPECT_THAT(MissingLevels(shard, level0->manifest()), ElementsAre(1));
}

TEST_F(ShardLevelsTest, ALevelOfAnotherVolumeIsTold) {
  const std::string shard = MakeShard();
  TestDataset other(volume::ScalarType::kUint16);
  ISOSCOPE_ASSERT_OK(other.Write(dir_.Sub("other")));
  fs::remove_all(shard + "/level_1");
  fs::rename(dir_.Sub("other/shard-00000-of-00001"), shard + "/level_1");
  EXPECT_THAT(OpenShardLevel(shard, 1).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("level_1: holds shard 0")));
}

TEST_F(ShardLevelsTest, ADatasetWithoutLevelsSaysSo) {
  TestDataset plain;
  ISOSCOPE_ASSERT_OK(plain.Write(dir_.Sub("plain")));
  EXPECT_THAT(OpenShardLevel(dir_.Sub("plain/shard-00000-of-00001"), 1).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("--add-levels")));
}

}  // namespace
}  // namespace isoscope::store
