// Levels that Partition writes, compared with brute force from the samples of the volume, and the
// same whatever the shards, the memory limit and the way of reading.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/io/file.h"
#include "core/partition/level_plan.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_levels.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/level_fixture.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using ::testing::Not;
using volume::LevelFilter;
using volume::ScalarType;

class PartitionLevelsTest : public PartitionerTest {};

TEST_F(PartitionLevelsTest, EveryLevelOfEveryTypeIsTheMeanOfTheOneBelow) {
  const math::Index3 dims{45, 38, 41};
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
        ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    SCOPED_TRACE(volume::NameOf(type));
    const Volume v{dims, type, Noise(dims, type)};
    PartitionOptions options = Options(std::string(volume::NameOf(type)));
    options.shard_count = 2;
    options.block_cells = {5, 4, 7};
    options.levels.highest = 2;
    ISOSCOPE_ASSERT_OK(Run(v, options));
    ExpectDatasetMatches(options.output_directory, v, options);
    ExpectLevelsMatch(options.output_directory, v, LevelFilter::kMean, 2);
  }
}

TEST_F(PartitionLevelsTest, OneNanMakesItsSampleNanAtEveryLevel) {
  const math::Index3 dims{20, 18, 16};
  Volume v{dims, ScalarType::kFloat32, Noise(dims, ScalarType::kFloat32)};
  const std::size_t at = static_cast<std::size_t>((5 * dims.y + 9) * dims.x + 14);
  base::StoreLittleEndian(std::numeric_limits<float>::quiet_NaN(), v.samples.data() + 4 * at);
  PartitionOptions options = Options("nan");
  options.levels.highest = 2;
  options.block_cells = {4, 4, 4};
  ISOSCOPE_ASSERT_OK(Run(v, options));
  ExpectLevelsMatch(options.output_directory, v, LevelFilter::kMean, 2);
  EXPECT_TRUE(std::isnan(SampleAt(LevelVolume(options.output_directory, v, 1), {7, 4, 2})));
  EXPECT_TRUE(std::isnan(SampleAt(LevelVolume(options.output_directory, v, 2), {3, 2, 1})));
}

TEST_F(PartitionLevelsTest, LabelsGetMajoritiesAndFloatsMeans) {
  const math::Index3 dims{21, 19, 18};
  for (const ScalarType type : {ScalarType::kUint8, ScalarType::kFloat32}) {
    SCOPED_TRACE(volume::NameOf(type));
    Volume v{dims, type, Noise(dims, type)};
    if (type == ScalarType::kUint8) {
      for (char& sample : v.samples) {
        sample = static_cast<char>(static_cast<unsigned char>(sample) % 3);
      }
    }
    PartitionOptions options = Options(absl::StrCat("labels-", volume::NameOf(type)));
    options.labels = {{.value = 1, .name = "one"}};
    options.levels.highest = 2;
    options.block_cells = {4, 4, 4};
    ISOSCOPE_ASSERT_OK(Run(v, options));
    ExpectLevelsMatch(options.output_directory, v,
                      type == ScalarType::kUint8 ? LevelFilter::kMajority : LevelFilter::kMean, 2);
  }
}

TEST_F(PartitionLevelsTest, TheFilterThatIsAskedForIsTaken) {
  const math::Index3 dims{16, 16, 16};
  const Volume v{dims, ScalarType::kUint16, Noise(dims, ScalarType::kUint16)};
  for (const LevelFilter filter : {LevelFilter::kMean, LevelFilter::kMajority}) {
    PartitionOptions options = Options(std::string(volume::NameOf(filter)));
    options.labels = {{.value = 1, .name = "one"}};
    options.levels = {.highest = 1, .filter = filter};
    options.block_cells = {4, 4, 4};
    ISOSCOPE_ASSERT_OK(Run(v, options));
    ExpectLevelsMatch(options.output_directory, v, filter, 1);
  }
}

// The digest of a level is over its samples and grid.
TEST_F(PartitionLevelsTest, SamplesAreTheSameForAnyShardsDistributionBlocksAndWayOfReading) {
  const math::Index3 dims{67, 70, 66};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  std::vector<std::string> first;
  int number = 0;
  for (const int shards : {1, 3, 16}) {
    for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
      PartitionOptions options = Options(absl::StrCat("d", number++));
      SCOPED_TRACE(options.output_directory);
      options.shard_count = shards;
      options.distribution = distribution;
      options.levels.highest = 2;
      options.block_cells = number % 2 == 0 ? math::Index3{4, 4, 4} : math::Index3{5, 6, 3};
      ScriptedSource source(SourceOf(v), Proceed, /*is_seekable=*/number % 3 != 0);
      options.memory_limit_bytes = LeastLimit(source, options) + 40 * base::kKiB;
      ISOSCOPE_ASSERT_OK(Partition(source, options, never_).status());
      const std::vector<std::string> digests = LevelDigests(options.output_directory);
      ASSERT_EQ(digests.size(), 2u);
      if (first.empty()) {
        first = digests;
        ExpectLevelsMatch(options.output_directory, v, LevelFilter::kMean, 2);
      }
      EXPECT_EQ(digests, first);
    }
  }
}

TEST_F(PartitionLevelsTest, FilesAreTheSameForEveryMemoryLimit) {
  const Volume v = LayeredVolume();
  std::map<std::string, std::string> first;
  for (const std::int64_t room : {std::int64_t{0}, std::int64_t{300}, base::kGiB / base::kKiB}) {
    PartitionOptions options = TwoShards(Options(absl::StrCat("room", room)));
    options.name = "same";
    options.block_cells = {4, 4, 4};
    options.levels.highest = 3;
    const auto source = SourceOf(v);
    options.memory_limit_bytes = LeastLimit(*source, options) + room * base::kKiB;
    ISOSCOPE_ASSERT_OK(Run(v, options));
    std::map<std::string, std::string> files = FilesBelow(options.output_directory);
    EXPECT_EQ(files.count("shard-00001-of-00002/level_3/blocks.bin"), 1u);
    if (first.empty()) {
      first = std::move(files);
    } else {
      EXPECT_EQ(files, first);
    }
  }
}

TEST_F(PartitionLevelsTest, NothingOfTheWorkIsLeft) {
  const math::Index3 dims{32, 32, 32};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  PartitionOptions options = TwoShards(Options("clean"));
  options.block_cells = {4, 4, 4};
  options.levels.highest = 2;
  ISOSCOPE_ASSERT_OK(Run(v, options));
  EXPECT_THAT(EntriesOf(options.output_directory),
              ::testing::UnorderedElementsAre("manifest.json", "ranges.bin", "shard-00000-of-00002",
                                              "shard-00001-of-00002"));
  EXPECT_THAT(EntriesOf(options.output_directory + "/shard-00001-of-00002"),
              ::testing::UnorderedElementsAre("manifest.json", "ranges.bin", "shard.json",
                                              "blocks.bin", "block_index.bin", "interval_tree.bin",
                                              "histogram.bin", "level_1", "level_2"));
}

// The dataset without levels is what it was, byte for byte; with them, all but the manifests is.
TEST_F(PartitionLevelsTest, LevelsChangeNoFileOfLevel0ButItsManifests) {
  const math::Index3 dims{32, 32, 32};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  PartitionOptions plain = TwoShards(Options("plain"));
  plain.name = "same";
  plain.block_cells = {4, 4, 4};
  PartitionOptions with = plain;
  with.output_directory = dir_.Sub("with");
  with.levels.highest = 2;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest before,
                                Partition(*SourceOf(v), plain, never_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest after, Partition(*SourceOf(v), with, never_));
  EXPECT_EQ(after.dataset_id, before.dataset_id);
  EXPECT_EQ(after.highest_level(), 2);
  const std::map<std::string, std::string> files = FilesBelow(with.output_directory);
  for (const auto& [path, bytes] : FilesBelow(plain.output_directory)) {
    const bool is_manifest = path.ends_with("manifest.json");
    EXPECT_EQ(files.at(path) == bytes, !is_manifest) << path;
    EXPECT_THAT(bytes, Not(HasSubstr("\"format_version\": 3"))) << path;
  }
}

TEST_F(PartitionLevelsTest, MoreLevelsThanPossibleAreRefusedBeforeAnythingIsRead) {
  const math::Index3 dims{32, 20, 32};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  PartitionOptions options = TwoShards(Options("many"));
  options.block_cells = {8, 8, 8};
  options.levels.highest = 9;
  const auto never_read = [](int) { return absl::InternalError("was read"); };
  ScriptedSource source(SourceOf(v), never_read);
  // Level 2 has 8 x 5 x 8 samples, which is one block: too few for two shards.
  EXPECT_THAT(Partition(source, options, never_).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0 to 1 are possible")));
  EXPECT_FALSE(io::PathExists(options.output_directory));
}

TEST_F(PartitionLevelsTest, AutoMakesNoneOfASmallVolume) {
  const math::Index3 dims{32, 32, 32};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  PartitionOptions options = Options("auto");
  options.levels.highest = LevelOptions::kAuto;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest,
                                Partition(*SourceOf(v), options, never_));
  EXPECT_EQ(manifest.highest_level(), 0);
}

TEST_F(PartitionLevelsTest, AnErrorOrACancellationLeavesNothing) {
  const Volume v = LayeredVolume();
  PartitionOptions options = TwoShards(Options("fails"));
  options.block_cells = {4, 4, 4};
  options.levels.highest = 3;
  base::Cancellation cancellation;
  // Cancelled while level 1 is written.
  options.progress = [&](const PartitionProgress& progress) {
    if (absl::string_view(progress.phase) == "writing levels") {
      cancellation.Cancel();
    }
  };
  EXPECT_THAT(Partition(*SourceOf(v), options, cancellation).status(),
              StatusIs(absl::StatusCode::kCancelled));
  EXPECT_TRUE(EntriesOf(dir_.path()).empty());
}

TEST_F(PartitionLevelsTest, ProgressCountsTheLevelsAndEndsAtTheTotal) {
  const math::Index3 dims{32, 32, 32};
  const Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  PartitionOptions options = Options("progress");
  options.levels.highest = 2;
  PartitionProgress last;
  options.progress = [&](const PartitionProgress& progress) {
    EXPECT_GE(progress.done_bytes, last.done_bytes);
    last = progress;
  };
  ISOSCOPE_ASSERT_OK(Run(v, options));
  EXPECT_EQ(last.total_bytes, 32 * 32 * 32 + 2 * (16 * 16 * 16 + 8 * 8 * 8));
  EXPECT_EQ(last.done_bytes, last.total_bytes);
}

}  // namespace
}  // namespace isoscope::partition
