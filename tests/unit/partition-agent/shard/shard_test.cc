
#include <filesystem>

#include "gtest/gtest.h"

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

}  // namespace
}  // namespace isoscope::agent
