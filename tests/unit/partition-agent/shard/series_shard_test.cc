#include "partition-agent/shard/series_shard.h"

#include <atomic>
#include <filesystem>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/io/atomic_file.h"
#include "core/partition/dataset_levels.h"
#include "core/partition/series_partitioner.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "partition-agent/shard_set.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::StatusIs;
using partition::FlowFields;
using partition::MemorySeries;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kAmpleBytes = std::size_t{1} << 30;
constexpr int kShardCount = 2;

class SeriesShardTest : public ::testing::Test {
 protected:
  SeriesShardTest() { Partition({0, 1}, directory()); }

  void Partition(const std::vector<double>& times, const std::string& directory) {
    MemorySeries source(FlowFields(), times);
    partition::SeriesPartitionOptions options;
    options.volume.output_directory = directory;
    options.volume.block_cells = math::Index3{4, 4, 4};
    options.volume.shard_count = kShardCount;
    ISOSCOPE_ASSERT_OK(partition::PartitionSeries(source, options, never_).status());
  }
  void Append(double time) {
    MemorySeries source(FlowFields(), {time});
    partition::SeriesPartitionOptions options;
    options.volume.output_directory = directory();
    ISOSCOPE_ASSERT_OK(partition::AppendToSeries(source, options, never_).status());
  }
  void AddLevels() {
    partition::AddLevelsOptions options;
    options.levels.highest = 1;
    ISOSCOPE_ASSERT_OK(partition::AddLevels(directory(), options, never_).status());
  }
  [[nodiscard]] std::string VolumeDirectory(const store::ScalarVolumeKey& key) const {
    return absl::StrCat(shard_directory(0), "/", store::ScalarVolumeDirectoryName(key));
  }
  [[nodiscard]] std::string directory() const { return temp_.Sub("flow"); }
  [[nodiscard]] std::string shard_directory(int shard) const {
    return absl::StrCat(directory(), "/", store::ShardDirectoryName(shard, kShardCount));
  }
  std::unique_ptr<SeriesShard> Open(std::size_t max_open_bytes = kAmpleBytes, int shard = 0) {
    auto series =
        SeriesShard::Open(shard_directory(shard), std::make_shared<OpenVolumes>(max_open_bytes));
    ISOSCOPE_EXPECT_OK(series.status());
    return *std::move(series);
  }

  const base::Cancellation never_;
  const testing::TempDir temp_;
};

TEST_F(SeriesShardTest, OpensTheVolumeThatIsAskedForAndNoOther) {
  const auto series = Open();
  const auto served = series->served();
  ASSERT_EQ(served->volumes.size(), 10U) << "a scalar, and x, y, z, magnitude, at two steps";
  std::set<std::uint32_t> numbers;
  for (const store::ScalarVolume& volume : served->volumes) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto shard, series->OpenVolume(volume.dataset_id));
    EXPECT_EQ(shard->reader->manifest().dataset_id, volume.dataset_id);
    EXPECT_EQ(shard->reader->shard_index(), 0);
    EXPECT_THAT(shard->reader->directory(), HasSubstr(ScalarVolumeDirectoryName(volume.key)));
    numbers.insert(shard->number);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, series->OpenVolume(volume.dataset_id));
    EXPECT_EQ(again, shard) << "opened once";
  }
  EXPECT_EQ(numbers.size(), 10U);
  EXPECT_THAT(series->OpenVolume("0123456789abcdef0123456789abcdef"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("not served")));
}

TEST_F(SeriesShardTest, ThreadsThatOpenOneVolumeGetTheSame) {
  const auto series = Open();
  const std::string id = series->served()->volumes[3].dataset_id;
  constexpr int kThreads = 8;
  std::vector<std::shared_ptr<const Shard>> found(kThreads);
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&, i] {
      const auto opening =
          i % 2 == 0 ? SeriesShard::Opening::kForFrame : SeriesShard::Opening::kAhead;
      auto shard = series->OpenVolume(id, opening);
      ISOSCOPE_EXPECT_OK(shard.status());
      found[static_cast<std::size_t>(i)] = *std::move(shard);
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const auto& shard : found) {
    EXPECT_EQ(shard, found[0]);
  }
}

TEST_F(SeriesShardTest, AVolumeThatWasClosedHasItsNumberAgainSoThatCachesStayValid) {
  const auto series = Open(/*max_open_bytes=*/1);  // room for the newest alone
  const auto served = series->served();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first,
                                series->OpenVolume(served->volumes[0].dataset_id));
  ISOSCOPE_ASSERT_OK(series->OpenVolume(served->volumes[1].dataset_id).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again,
                                series->OpenVolume(served->volumes[0].dataset_id));
  EXPECT_NE(again, first) << "it was closed";
  EXPECT_EQ(again->number, first->number);
}

TEST_F(SeriesShardTest, NoticesAStepThatWasAppendedAndServesTheOldOnesOn) {
  const auto series = Open();
  const auto before = series->served();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto old, series->OpenVolume(before->volumes[0].dataset_id));
  Append(2);
  EXPECT_EQ(series->served(), before) << "nobody has looked";
  series->Refresh();
  const auto after = series->served();
  EXPECT_EQ(after->volumes.size(), 15U);
  EXPECT_EQ(after->manifest.dataset_id, before->manifest.dataset_id);
  ISOSCOPE_ASSERT_OK(series->OpenVolume(after->volumes.back().dataset_id).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto still,
                                series->OpenVolume(before->volumes[0].dataset_id));
  EXPECT_EQ(still, old);
}

TEST_F(SeriesShardTest, AVolumeWhoseFolderIsNotThereYetIsServedOnceItIs) {
  const std::string folder = absl::StrCat(
      shard_directory(0), "/", store::ScalarVolumeDirectoryName({.field = 0, .step = 1}));
  std::filesystem::rename(folder, temp_.Sub("aside"));
  const auto series = Open();
  EXPECT_EQ(series->served()->volumes.size(), 9U);
  series->Refresh();
  EXPECT_EQ(series->served()->volumes.size(), 9U);
  std::filesystem::rename(temp_.Sub("aside"), folder);
  series->Refresh();
  EXPECT_EQ(series->served()->volumes.size(), 10U);
}

TEST_F(SeriesShardTest, AManifestOfAnotherSeriesOrADamagedOneChangesNothing) {
  Partition({5}, temp_.Sub("other"));
  const auto series = Open();
  const auto before = series->served();
  const std::string manifest = absl::StrCat(shard_directory(0), "/", store::kManifestFileName);
  ISOSCOPE_ASSERT_OK(io::WriteFileAtomically(manifest, "{}"));
  series->Refresh();
  EXPECT_EQ(series->served(), before);
  std::filesystem::copy_file(absl::StrCat(temp_.Sub("other"), "/", store::kManifestFileName),
                             manifest, std::filesystem::copy_options::overwrite_existing);
  series->Refresh();
  EXPECT_EQ(series->served(), before);
  ISOSCOPE_EXPECT_OK(series->OpenVolume(before->volumes[3].dataset_id).status());
}

// A Refresh that had read the older manifest ended after another, and served the older list on.
TEST_F(SeriesShardTest, ASlowRefreshDoesNotBringAnOlderListBack) {
  std::atomic<bool> is_slow = false;
  absl::Notification has_read;
  absl::Notification may_return;
  const auto read = [&](const std::string& directory) {
    auto shard = store::OpenSeriesShard(directory);
    if (is_slow.exchange(false)) {
      has_read.Notify();
      may_return.WaitForNotification();
    }
    return shard;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      SeriesShard::Open(shard_directory(0), std::make_shared<OpenVolumes>(kAmpleBytes), read));
  Append(2);
  is_slow = true;
  std::thread slow([&] { series->Refresh(); });
  has_read.WaitForNotification();
  Append(3);
  series->Refresh();  // meanwhile
  may_return.Notify();
  slow.join();
  series->Refresh();
  EXPECT_EQ(series->served()->volumes.size(), 20U);
}

// The stamp of a manifest that could not be read counted as read.
TEST_F(SeriesShardTest, AFailedReadIsTriedAgain) {
  bool fails = false;
  const auto read = [&](const std::string& directory) -> absl::StatusOr<store::SeriesShard> {
    return fails ? absl::DataLossError("injected: EIO") : store::OpenSeriesShard(directory);
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      SeriesShard::Open(shard_directory(0), std::make_shared<OpenVolumes>(kAmpleBytes), read));
  Append(2);
  fails = true;
  series->Refresh();
  EXPECT_EQ(series->served()->volumes.size(), 10U);
  fails = false;
  series->Refresh();
  EXPECT_EQ(series->served()->volumes.size(), 15U);
}

TEST_F(SeriesShardTest, PlacesAVolumeAmongTheServedStepsOfItsField) {
  Append(2);
  Append(3);
  std::filesystem::remove_all(absl::StrCat(
      shard_directory(0), "/", store::ScalarVolumeDirectoryName({.field = 1, .step = 2})));
  const auto series = Open();
  const std::string id = series->IdOf({.field = 1, .step = 3});
  const auto place = series->PlaceOf(id);
  ASSERT_TRUE(place.has_value());
  EXPECT_EQ(place->key, (store::ScalarVolumeKey{.field = 1, .step = 3}));
  EXPECT_EQ(place->steps, (std::vector<int>{0, 1, 3}));
  EXPECT_EQ(place->position, 2U);
  EXPECT_EQ(series->IdOf({.field = 1, .step = 2}), "");
  EXPECT_FALSE(series->PlaceOf("0123456789abcdef0123456789abcdef").has_value());
}

TEST_F(SeriesShardTest, AFolderWithTheFilesOfAnotherVolumeIsDataLoss) {
  const auto folder = [&](int step) {
    return absl::StrCat(shard_directory(0), "/",
                        store::ScalarVolumeDirectoryName({.field = 0, .step = step}));
  };
  std::filesystem::remove_all(folder(0));
  std::filesystem::copy(folder(1), folder(0), std::filesystem::copy_options::recursive);
  const auto series = Open();
  EXPECT_THAT(series->OpenVolume(series->served()->volumes[0].dataset_id),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the series expects")));
}

TEST_F(SeriesShardTest, OpensTheLevelThatIsAskedForUnderANumberOfItsOwn) {
  AddLevels();
  const auto series = Open();
  const auto served = series->served();
  ASSERT_EQ(served->levels.size(), served->volumes.size());
  EXPECT_EQ(served->levels[0], std::vector<int>{1});
  const std::string id = served->volumes[0].dataset_id;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto level, series->OpenVolume(id, SeriesShard::Opening::kForFrame, /*level=*/1));
  EXPECT_EQ(level->reader->manifest().geometry.sample_dims, (math::Index3{6, 5, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole, series->OpenVolume(id));
  EXPECT_EQ(whole->reader->manifest().geometry.sample_dims, (math::Index3{13, 11, 9}));
  EXPECT_NE(level->number, whole->number) << "caches would mix up their blocks";
  EXPECT_THAT(series->OpenVolume(id, SeriesShard::Opening::kForFrame, /*level=*/2),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("no level 2")));
}

TEST_F(SeriesShardTest, LevelsThatComeWhileAVolumeIsOpenAreOpenedToo) {
  const auto series = Open();
  const std::string id = series->served()->volumes[0].dataset_id;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole, series->OpenVolume(id));
  AddLevels();
  series->Refresh();
  EXPECT_EQ(series->served()->levels[0], std::vector<int>{1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto means, series->OpenVolume(id, SeriesShard::Opening::kForFrame, /*level=*/1));
  EXPECT_EQ(means->reader->manifest().geometry.sample_dims, (math::Index3{6, 5, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, series->OpenVolume(id));
  EXPECT_EQ(again, whole) << "level 0 is as it was";
  ISOSCOPE_ASSERT_OK(partition::DropLevels(directory(), never_));
  series->Refresh();
  EXPECT_THAT(series->served()->levels[0], ::testing::IsEmpty());
}

TEST_F(SeriesShardTest, ALevelWhoseFolderIsNotThereYetIsServedOnceItIs) {
  AddLevels();
  const std::string folder = store::LevelDirectory(VolumeDirectory({.field = 0, .step = 1}), 1);
  std::filesystem::rename(folder, temp_.Sub("aside"));
  const auto series = Open();
  const std::string id = series->IdOf({.field = 0, .step = 1});
  const auto levels_of = [&] {
    const auto served = series->served();
    for (std::size_t i = 0; i < served->volumes.size(); ++i) {
      if (served->volumes[i].dataset_id == id) {
        return served->levels[i];
      }
    }
    return std::vector<int>{-1};
  };
  EXPECT_THAT(levels_of(), ::testing::IsEmpty());
  EXPECT_THAT(series->OpenVolume(id, SeriesShard::Opening::kForFrame, /*level=*/1),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("lacks level 1")));
  std::filesystem::rename(temp_.Sub("aside"), folder);
  series->Refresh();
  EXPECT_EQ(levels_of(), std::vector<int>{1});
  ISOSCOPE_EXPECT_OK(series->OpenVolume(id, SeriesShard::Opening::kForFrame, /*level=*/1).status());
}

TEST_F(SeriesShardTest, TheSetOfAnAgentFindsTheShardsOfOneVolume) {
  SeriesShards both;
  both.push_back(Open(kAmpleBytes, 1));
  both.push_back(Open(kAmpleBytes, 0));
  const std::string id = both[0]->served()->volumes[4].dataset_id;
  const ShardSet set({}, both);
  google::protobuf::RepeatedField<std::int32_t> indices;
  indices.Add(0);
  indices.Add(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Shards found, set.Find(id, indices));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0]->reader->shard_index(), 0);
  EXPECT_EQ(found[1]->reader->shard_index(), 1);
  EXPECT_EQ(found[1]->reader->manifest().dataset_id, id);
  indices.Add(2);
  EXPECT_THAT(set.Find(id, indices), StatusIs(absl::StatusCode::kInvalidArgument));
  ISOSCOPE_EXPECT_OK(set.FindAny(id).status());
}

}  // namespace
}  // namespace isoscope::agent
