// What an agent tells while it opens its shards, and how that ends early.

#include "partition-agent/opening.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "partition-agent/shard/shard.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::SmallDataset;
using ::isoscope::testing::StatusIs;

std::vector<std::string> DirectoriesOf(const SmallDataset& dataset, int shard_count) {
  std::vector<std::string> directories;
  for (int shard = 0; shard < shard_count; ++shard) {
    directories.push_back(dataset.shard_directory(shard));
  }
  return directories;
}

TEST(OpeningTest, BytesOfTablesAndShardsAreCountedUntilAllAreOpen) {
  const SmallDataset dataset(2);
  const std::vector<std::string> directories = DirectoriesOf(dataset, 2);
  const base::Cancellation never;
  Opening opening;
  opening.Begin(directories);
  EXPECT_EQ(opening.progress().shard_count, 2);
  EXPECT_EQ(opening.progress().open_shard_count, 0);
  EXPECT_EQ(opening.progress().read_bytes, 0);
  EXPECT_EQ(opening.progress().datasets.size(), 1U);
  const auto open_file = [&](const std::string& path) { return opening.OpenFile(path, never); };
  for (const std::string& directory : directories) {
    EXPECT_THAT(OpenShard(directory, NextShardNumber(), open_file), IsOk());
    opening.NoteOpen();
  }
  EXPECT_EQ(opening.progress().open_shard_count, 2);
  EXPECT_GT(opening.progress().table_bytes, 0);
  EXPECT_EQ(opening.progress().read_bytes, opening.progress().table_bytes);
}

TEST(OpeningTest, ACancelledOpeningEnds) {
  const SmallDataset dataset(1);
  base::Cancellation cancelled;
  cancelled.Cancel();
  Opening opening;
  opening.Begin(DirectoriesOf(dataset, 1));
  EXPECT_THAT(OpenShard(dataset.shard_directory(0), NextShardNumber(),
                        [&](const std::string& path) { return opening.OpenFile(path, cancelled); }),
              StatusIs(absl::StatusCode::kCancelled));
}

TEST(OpeningTest, AManifestThatCanNotBeReadNamesNoDataset) {
  Opening opening;
  opening.Begin({"/nowhere"});
  EXPECT_EQ(opening.progress().shard_count, 1);
  EXPECT_TRUE(opening.progress().datasets.empty());
}

TEST(OpeningTest, TheProgressAsText) {
  EXPECT_EQ(
      ToString(
          {.shard_count = 8, .open_shard_count = 3, .table_bytes = 3 << 20, .read_bytes = 3 << 19}),
      "3 of 8 shards are open, 1.5 MiB of 3.0 MiB of tables are read");
}

}  // namespace
}  // namespace isoscope::agent
