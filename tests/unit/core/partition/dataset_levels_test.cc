// Levels of datasets that exist: added ones have the bytes of partitioning with levels, dropped
// ones leave the bytes of partitioning without, whatever was interrupted before.

#include "core/partition/dataset_levels.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/partition/dataset_verifier.h"
#include "core/partition/series_partitioner.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_levels.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/level_fixture.h"
#include "tests/unit/core/partition/partitioner_fixture.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::partition {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;
using volume::LevelFilter;
using volume::ScalarType;

using Files = std::map<std::string, std::string>;

class DatasetLevelsTest : public PartitionerTest {
 protected:
  // A volume of three shards.
  Volume NoiseVolume(ScalarType type = ScalarType::kUint8) const {
    const math::Index3 dims{37, 34, 33};
    return {dims, type, Noise(dims, type)};
  }
  PartitionOptions Cut(const std::string& folder, int levels) const {
    PartitionOptions options = Options(folder);
    options.name = "same";
    options.shard_count = 3;
    options.block_cells = {4, 5, 3};
    options.levels.highest = levels;
    return options;
  }
  absl::StatusOr<int> Add(const std::string& folder, int levels) {
    AddLevelsOptions options;
    options.levels.highest = levels;
    return AddLevels(dir_.Sub(folder), options, never_);
  }
  Files FilesOf(const std::string& folder) const { return FilesBelow(dir_.Sub(folder)); }

  SeriesPartitionOptions SeriesCut(const std::string& folder, int levels) const {
    SeriesPartitionOptions options;
    options.volume.output_directory = dir_.Sub(folder);
    options.volume.name = "same";
    options.volume.block_cells = math::Index3{4, 4, 4};
    options.volume.shard_count = 2;
    options.volume.levels.highest = levels;
    return options;
  }
  absl::Status MakeSeries(const std::string& folder, int levels, std::vector<double> times) {
    MemorySeries source(FlowFields(), std::move(times));
    return PartitionSeries(source, SeriesCut(folder, levels), never_).status();
  }
  void ExpectNoDamage(const std::string& folder) {
    std::vector<std::string> damages;
    VerifyOptions options;
    options.damage = [&](const std::string& text) { damages.push_back(text); };
    ISOSCOPE_EXPECT_OK(VerifyDataset(dir_.Sub(folder), options, never_).status());
    EXPECT_THAT(damages, IsEmpty());
  }
};

TEST_F(DatasetLevelsTest, AddedLevelsHaveTheBytesOfPartitioningWithThem) {
  int number = 0;
  for (const ScalarType type : {ScalarType::kUint8, ScalarType::kInt16, ScalarType::kFloat32}) {
    for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
      const Volume v = NoiseVolume(type);
      const std::string expected = absl::StrCat("expected", number);
      const std::string added = absl::StrCat("added", number++);
      SCOPED_TRACE(added);
      PartitionOptions options = Cut(expected, 2);
      options.distribution = distribution;
      options.compression =
          number % 2 == 0 ? store::BlockEncoding::kRaw : store::BlockEncoding::kLz4;
      ISOSCOPE_ASSERT_OK(Run(v, options));
      options.output_directory = dir_.Sub(added);
      options.levels = {};
      ISOSCOPE_ASSERT_OK(Run(v, options));
      const Files before = FilesOf(added);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const int highest,
          AddLevels(dir_.Sub(added), {.levels = {.highest = 2}, .compression = options.compression},
                    never_));
      EXPECT_EQ(highest, 2);
      EXPECT_EQ(FilesOf(added), FilesOf(expected));
      ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub(added), never_));
      EXPECT_EQ(FilesOf(added), before);
    }
  }
}

TEST_F(DatasetLevelsTest, AnyMemoryLimitGivesTheSameBytes) {
  const Volume v = LayeredVolume();
  PartitionOptions options = TwoShards(Options("expected"));
  options.name = "same";
  options.block_cells = {4, 4, 4};
  options.levels.highest = 3;
  ISOSCOPE_ASSERT_OK(Run(v, options));
  options.levels = {};
  AddLevelsOptions adding{.levels = {.highest = 3}};
  options.output_directory = dir_.Sub("least");
  ISOSCOPE_ASSERT_OK(Run(v, options));
  // Bands of one row of blocks, and whole layers. A refusal says how much is needed.
  int refusals = 0;
  std::int64_t least = 1;
  for (;; ++refusals) {
    ASSERT_LT(refusals, 9);
    adding.memory_limit_bytes = least;
    const absl::StatusOr<int> added = AddLevels(dir_.Sub("least"), adding, never_);
    if (added.ok()) {
      break;
    }
    ASSERT_THAT(added, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("needs ")));
    const std::string message(added.status().message());
    least = std::stoll(message.substr(message.find("needs ") + 6));
  }
  EXPECT_GT(refusals, 0);
  for (const std::int64_t limit : {least, 2 * least, base::kGiB}) {
    ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("least"), never_));
    adding.memory_limit_bytes = limit;
    ISOSCOPE_ASSERT_OK(AddLevels(dir_.Sub("least"), adding, never_).status());
    EXPECT_EQ(FilesOf("least"), FilesOf("expected")) << limit;
  }
}

TEST_F(DatasetLevelsTest, LabelsAndFiltersAreThoseOfPartitioning) {
  const Volume v = NoiseVolume();
  PartitionOptions options = Cut("labels", 0);
  options.labels = {{.value = 1, .name = "one"}};
  ISOSCOPE_ASSERT_OK(Run(v, options));
  ISOSCOPE_ASSERT_OK(Add("labels", 2).status());
  ExpectLevelsMatch(dir_.Sub("labels"), v, LevelFilter::kMajority, 2);
  // Other levels are refused until these are dropped.
  EXPECT_THAT(Add("labels", 1), StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("majority")));
  const AddLevelsOptions means{.levels = {.highest = 2, .filter = LevelFilter::kMean}};
  EXPECT_THAT(AddLevels(dir_.Sub("labels"), means, never_),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("--drop-levels")));
  ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("labels"), never_));
  ISOSCOPE_ASSERT_OK(AddLevels(dir_.Sub("labels"), means, never_).status());
  ExpectLevelsMatch(dir_.Sub("labels"), v, LevelFilter::kMean, 2);
}

TEST_F(DatasetLevelsTest, WhatIsThereAlreadyIsLeft) {
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("done", 2)));
  const Files before = FilesOf("done");
  bool was_read = false;
  AddLevelsOptions options{.levels = {.highest = 2}};
  options.progress = [&](const PartitionProgress&) { was_read = true; };
  ISOSCOPE_ASSERT_OK(AddLevels(dir_.Sub("done"), options, never_).status());
  EXPECT_FALSE(was_read);
  EXPECT_EQ(FilesOf("done"), before);
}

TEST_F(DatasetLevelsTest, AutoAddsNoneToASmallVolume) {
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("small", 0)));
  const Files before = FilesOf("small");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int highest, Add("small", LevelOptions::kAuto));
  EXPECT_EQ(highest, 0);
  EXPECT_EQ(FilesOf("small"), before);
  ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("small"), never_));
  EXPECT_EQ(FilesOf("small"), before);
}

// Cancelled at every report of progress in turn: the dataset stays whole, and the next run ends
// what was begun.
TEST_F(DatasetLevelsTest, AnInterruptedRunLeavesAWholeDatasetAndIsDoneAgain) {
  const Volume v = NoiseVolume();
  ISOSCOPE_ASSERT_OK(Run(v, Cut("expected", 2)));
  ISOSCOPE_ASSERT_OK(Run(v, Cut("broken", 0)));
  const Files before = FilesOf("broken");
  for (int at = 1;; ++at) {
    base::Cancellation cancellation;
    int reports = 0;
    AddLevelsOptions options{.levels = {.highest = 2}};
    options.progress = [&](const PartitionProgress&) {
      if (++reports == at) {
        cancellation.Cancel();
      }
    };
    const absl::StatusOr<int> added = AddLevels(dir_.Sub("broken"), options, cancellation);
    if (reports < at) {
      ISOSCOPE_EXPECT_OK(added.status());
      EXPECT_GT(at, 5);
      break;
    }
    ExpectNoDamage("broken");
    const Files after = FilesOf("broken");
    for (const auto& [path, bytes] : before) {
      ASSERT_TRUE(added.ok() || after.at(path) == bytes) << at << " " << path;
    }
    ISOSCOPE_ASSERT_OK(Add("broken", 2).status());
    ASSERT_EQ(FilesOf("broken"), FilesOf("expected")) << at;
    ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("broken"), never_));
    ASSERT_EQ(FilesOf("broken"), before) << at;
  }
  EXPECT_EQ(FilesOf("broken"), FilesOf("expected"));
}

// As a process leaves it that is killed while it replaces manifests, adding or dropping.
TEST_F(DatasetLevelsTest, ManifestsThatDifferAreToldAndMended) {
  const Volume v = NoiseVolume();
  ISOSCOPE_ASSERT_OK(Run(v, Cut("expected", 2)));
  ISOSCOPE_ASSERT_OK(Run(v, Cut("plain", 0)));
  const std::string manifest = "/shard-00001-of-00003/manifest.json";
  for (const bool adds : {true, false}) {
    fs::copy(dir_.Sub("expected"), dir_.Sub("mixed"), fs::copy_options::recursive);
    testing::WriteFile(dir_.Sub("mixed") + manifest,
                       testing::ReadFile(dir_.Sub("plain") + manifest));
    std::vector<std::string> damages;
    VerifyOptions options;
    options.damage = [&](const std::string& text) { damages.push_back(text); };
    ISOSCOPE_ASSERT_OK(VerifyDataset(dir_.Sub("mixed"), options, never_).status());
    EXPECT_THAT(damages, ElementsAre(HasSubstr("names 0 levels, the dataset's manifest 2")));
    // Every shard serves level 0, and those that name levels serve these.
    for (const std::string& shard : ShardsOf(dir_.Sub("mixed"))) {
      ISOSCOPE_EXPECT_OK(store::ShardReader::Open(shard).status());
    }
    if (adds) {
      ISOSCOPE_ASSERT_OK(Add("mixed", 2).status());
    } else {
      ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("mixed"), never_));
    }
    EXPECT_EQ(FilesOf("mixed"), FilesOf(adds ? "expected" : "plain"));
    fs::remove_all(dir_.Sub("mixed"));
  }
}

TEST_F(DatasetLevelsTest, AShardWithoutALevelSaysSoAndServesTheRest) {
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("dataset", 2)));
  const std::string shard = dir_.Sub("dataset/shard-00002-of-00003");
  fs::rename(shard + "/level_2", dir_.Sub("kept"));
  EXPECT_THAT(store::OpenShardLevel(shard, 2).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("shard 2 of 3 lacks level 2")));
  EXPECT_THAT(store::OpenShardLevel(shard, 3).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("has no level 3, only 0 to 2")));
  ISOSCOPE_EXPECT_OK(store::OpenShardLevel(shard, 0).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto level1, store::OpenShardLevel(shard, 1));
  EXPECT_EQ(level1->shard_index(), 2);
  EXPECT_THAT(store::MissingLevels(shard, store::ShardReader::Open(shard).value()->manifest()),
              ElementsAre(2));
  // That of another shard is told apart, and so is another level.
  for (const std::string& other :
       {dir_.Sub("dataset/shard-00001-of-00003/level_2"), shard + "/level_1"}) {
    fs::copy(other, shard + "/level_2", fs::copy_options::recursive);
    EXPECT_THAT(store::OpenShardLevel(shard, 2).status(),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("level_2: holds shard")));
    fs::remove_all(shard + "/level_2");
  }
  // Adding makes it again.
  ISOSCOPE_ASSERT_OK(Add("dataset", 2).status());
  ISOSCOPE_EXPECT_OK(store::OpenShardLevel(shard, 2).status());
  ExpectNoDamage("dataset");
}

// A copy that was cut off: verify names it, and adding must not take it for whole.
TEST_F(DatasetLevelsTest, ALevelWithAFileThatIsCutOffIsMadeAgain) {
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("dataset", 2)));
  const Files before = FilesOf("dataset");
  for (const char* const file : {"blocks.bin", "block_index.bin", "ranges.bin", "shard.json"}) {
    const std::string path = dir_.Sub("dataset/shard-00001-of-00003/level_1/") + file;
    fs::resize_file(path, fs::file_size(path) / 2);
    ISOSCOPE_ASSERT_OK(Add("dataset", 2).status());
    ASSERT_EQ(FilesOf("dataset"), before) << file;
  }
}

TEST_F(DatasetLevelsTest, WhatIsNotThereIsAnError) {
  EXPECT_THAT(Add("nothing", 1), StatusIs(absl::StatusCode::kNotFound));
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("dataset", 0)));
  EXPECT_THAT(Add("dataset/shard-00000-of-00003", 1),
              StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Add("dataset", 9),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("are possible")));
  fs::remove_all(dir_.Sub("dataset/shard-00001-of-00003"));
  EXPECT_THAT(Add("dataset", 1),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("shard 1 of 3 is not there")));
  EXPECT_FALSE(io::PathExists(dir_.Sub("dataset/levels.partial")));
}

TEST_F(DatasetLevelsTest, AManifestOfANewerProgramIsNotReplaced) {
  ISOSCOPE_ASSERT_OK(Run(NoiseVolume(), Cut("dataset", 0)));
  const std::string path = dir_.Sub("dataset/manifest.json");
  std::string text = testing::ReadFile(path);
  const std::string seal = "\"crc32c\": \"";
  const std::size_t digits = text.find(seal) + seal.size();
  text.replace(digits, 8, "00000000");
  text.insert(digits - seal.size(), "\"later\": 1,\n  ");
  testing::WriteFile(path, store::SealJson(text));
  ISOSCOPE_EXPECT_OK(store::OpenDataset(dir_.Sub("dataset")).status());
  const Files before = FilesOf("dataset");
  EXPECT_THAT(Add("dataset", 1), StatusIs(absl::StatusCode::kFailedPrecondition,
                                          HasSubstr("members that this program does not know")));
  EXPECT_THAT(DropLevels(dir_.Sub("dataset"), never_),
              StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(FilesOf("dataset"), before);
}

TEST_F(DatasetLevelsTest, SeriesGetTheBytesOfPartitioningWithLevels) {
  ISOSCOPE_ASSERT_OK(MakeSeries("expected", 1, {0, 1}));
  ISOSCOPE_ASSERT_OK(MakeSeries("added", 0, {0, 1}));
  const Files before = FilesOf("added");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int highest, Add("added", 1));
  EXPECT_EQ(highest, 1);
  EXPECT_EQ(FilesOf("added"), FilesOf("expected"));
  ExpectNoDamage("added");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, store::OpenSeries(dir_.Sub("added")));
  EXPECT_EQ(series.manifest.highest_level(), 1);
  for (const store::ScalarVolume& volume : series.manifest.volumes) {
    EXPECT_EQ(volume.highest_level, 1);
    ISOSCOPE_EXPECT_OK(
        store::OpenShardLevel(absl::StrCat(series.shard_directories[1], "/",
                                           store::ScalarVolumeDirectoryName(volume.key)),
                              1)
            .status());
  }
  ISOSCOPE_ASSERT_OK(DropLevels(dir_.Sub("added"), never_));
  EXPECT_EQ(FilesOf("added"), before);
}

TEST_F(DatasetLevelsTest, AnInterruptedSeriesGoesOn) {
  ISOSCOPE_ASSERT_OK(MakeSeries("expected", 1, {0}));
  ISOSCOPE_ASSERT_OK(MakeSeries("broken", 0, {0}));
  base::Cancellation cancellation;
  AddLevelsOptions options{.levels = {.highest = 1}};
  options.progress = [&](const PartitionProgress& progress) {
    if (absl::StartsWith(progress.phase, "volume 3 ")) {
      cancellation.Cancel();
    }
  };
  EXPECT_THAT(AddLevels(dir_.Sub("broken"), options, cancellation),
              StatusIs(absl::StatusCode::kCancelled));
  std::map<std::string, int> phases;
  options.progress = [&](const PartitionProgress& progress) { ++phases[progress.phase]; };
  ISOSCOPE_ASSERT_OK(AddLevels(dir_.Sub("broken"), options, never_).status());
  EXPECT_EQ(phases.count("volume 2 of 5"), 0u);
  EXPECT_EQ(phases.count("volume 3 of 5"), 1u);
  EXPECT_EQ(FilesOf("broken"), FilesOf("expected"));
}

TEST_F(DatasetLevelsTest, AppendedStepsGetTheLevelsOfTheSeries) {
  ISOSCOPE_ASSERT_OK(MakeSeries("expected", 1, {0, 1}));
  ISOSCOPE_ASSERT_OK(MakeSeries("appended", 1, {0}));
  MemorySeries later(FlowFields(), {1});
  SeriesPartitionOptions options;
  options.volume.output_directory = dir_.Sub("appended");
  ISOSCOPE_ASSERT_OK(AppendToSeries(later, options, never_).status());
  EXPECT_EQ(FilesOf("appended"), FilesOf("expected"));
}

// A run that resumes takes no volume with other levels.
TEST_F(DatasetLevelsTest, ResumingTakesVolumesWithTheseLevelsAlone) {
  ISOSCOPE_ASSERT_OK(MakeSeries("expected", 1, {0}));
  for (const int levels : {0, 1}) {
    MemorySeries source(FlowFields(), {0});
    source.before_open = [opened = 0](int, int, int) mutable {
      return ++opened == 15 ? absl::CancelledError("stop") : absl::OkStatus();
    };
    EXPECT_FALSE(PartitionSeries(source, SeriesCut("resumed", levels), never_).ok());
    ASSERT_TRUE(io::PathExists(dir_.Sub("resumed.partial")));
    SeriesPartitionOptions options = SeriesCut("resumed", 1);
    options.resumes = true;
    MemorySeries whole(FlowFields(), {0});
    ISOSCOPE_ASSERT_OK(PartitionSeries(whole, options, never_).status());
    EXPECT_EQ(FilesOf("resumed"), FilesOf("expected")) << levels;
    fs::remove_all(dir_.Sub("resumed"));
  }
}

TEST_F(DatasetLevelsTest, OnlyOneProcessWrites) {
  ISOSCOPE_ASSERT_OK(MakeSeries("flow", 0, {0}));
  absl::Status appended;
  AddLevelsOptions options{.levels = {.highest = 1}};
  options.progress = [&](const PartitionProgress&) {
    MemorySeries later(FlowFields(), {1});
    SeriesPartitionOptions appending;
    appending.volume.output_directory = dir_.Sub("flow");
    appended = AppendToSeries(later, appending, never_).status();
  };
  ISOSCOPE_ASSERT_OK(AddLevels(dir_.Sub("flow"), options, never_).status());
  EXPECT_THAT(appended, StatusIs(absl::StatusCode::kFailedPrecondition,
                                 HasSubstr("another process writes there")));
  EXPECT_THAT(
      EntriesOf(dir_.Sub("flow")),
      UnorderedElementsAre("manifest.json", "shard-00000-of-00002", "shard-00001-of-00002"));
}

}  // namespace
}  // namespace isoscope::partition
