// Runs that do not end normally must leave nothing that looks like a dataset:
//
// - cancelled at a read of the source, with each distribution and memory limit;
// - failed by the source, or by a full disk (a limit on file sizes) while sorting on disk;
// - killed, as a copy of the folder in the middle of a run shows.

#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/resource.h>

#include "core/base/units.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {
namespace {

class PartitionerFailureTest : public PartitionerTest {};

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;
using volume::ScalarType;

// Options of a run, and the reads at which it is interrupted.
struct Interruption {
  PartitionOptions options;
  bool is_seekable;
  int at_read;
};

class InterruptionTest : public PartitionerFailureTest {
 protected:
  std::vector<Interruption> Interruptions() {
    std::vector<Interruption> interruptions;
    for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
      for (const bool is_seekable : {true, false}) {
        for (const std::int64_t more : {0, 1 << 30}) {
          PartitionOptions options = Options("interrupted");
          options.shard_count = 2;
          options.distribution = distribution;
          ScriptedSource source(SourceOf(LayeredVolume()), Proceed, is_seekable);
          options.memory_limit_bytes = LeastLimit(source, options) + more;
          EXPECT_THAT(Partition(source, options, never_).status(), testing::IsOk());
          std::filesystem::remove_all(options.output_directory);
          const int reads = source.read_count();
          for (int part = 0; part <= 4; ++part) {
            interruptions.push_back({options, is_seekable, (reads - 1) * part / 4});
          }
        }
      }
    }
    return interruptions;
  }
};

TEST_F(InterruptionTest, CancellationAtAnyReadLeavesNothing) {
  for (const Interruption& interruption : Interruptions()) {
    base::Cancellation cancellation;
    ScriptedSource source(
        SourceOf(LayeredVolume()),
        [&](int read) {
          if (read == interruption.at_read) {
            cancellation.Cancel();
          }
          return absl::OkStatus();
        },
        interruption.is_seekable);
    EXPECT_THAT(Partition(source, interruption.options, cancellation).status(),
                StatusIs(absl::StatusCode::kCancelled, _));
    EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty()) << interruption.at_read;
  }
}

TEST_F(InterruptionTest, SourceErrorAtAnyReadIsReturnedAndLeavesNothing) {
  for (const Interruption& interruption : Interruptions()) {
    ScriptedSource source(
        SourceOf(LayeredVolume()),
        [&](int read) {
          return read == interruption.at_read ? absl::DataLossError("source broke")
                                              : absl::OkStatus();
        },
        interruption.is_seekable);
    EXPECT_THAT(Partition(source, interruption.options, never_).status(),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("source broke")));
    EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty()) << interruption.at_read;
  }
}

TEST_F(PartitionerFailureTest, WriteThatFailsLeavesNothing) {
  // A file size limit stands in for a full disk: writes beyond it fail.
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const rlim_t limit : {rlim_t{1}, rlim_t{20000}, rlim_t{300000}}) {
    rlimit small = before;
    small.rlim_cur = limit;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    const absl::Status status = Run(LayeredVolume(), TwoShards(Options("full")));
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_FALSE(status.ok()) << limit;
    EXPECT_THAT(std::string(status.message()), HasSubstr("full.partial-")) << limit;
    EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty()) << limit;
  }
  std::signal(SIGXFSZ, old_handler);
}

// 59319 blocks of one cell: more than the sorters of a small limit hold.
Volume VolumeOfManyBlocks() {
  const math::Index3 dims{40, 40, 40};
  return {dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
}

TEST_F(PartitionerFailureTest, BlocksBeyondTheLimitAreSortedOnDiskIntoTheSameBytes) {
  const Volume v = VolumeOfManyBlocks();
  PartitionOptions options = Options("many");
  options.block_cells = {1, 1, 1};
  for (const int shard_count : {1, 5}) {
    options.shard_count = shard_count;
    options.memory_limit_bytes = base::kGiB;
    ISOSCOPE_ASSERT_OK(Run(v, options));
    const auto expected = FilesBelow(options.output_directory);
    std::filesystem::remove_all(options.output_directory);
    options.memory_limit_bytes = LeastLimit(*SourceOf(v), options);
    EXPECT_LT(options.memory_limit_bytes, 59319 * 150);
    ISOSCOPE_ASSERT_OK(Run(v, options));
    EXPECT_TRUE(FilesBelow(options.output_directory) == expected);
    std::filesystem::remove_all(options.output_directory);
  }
}

TEST_F(PartitionerFailureTest, DiskThatIsFullWhileSortingLeavesNothing) {
  const Volume v = VolumeOfManyBlocks();
  PartitionOptions options = TwoShards(Options("full"));
  options.block_cells = {1, 1, 1};
  options.memory_limit_bytes = LeastLimit(*SourceOf(v), options);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  // The first run of placements (24 bytes a block) does not fit, or the third, or the samples and
  // the entries of blocks.
  for (const rlim_t limit : {rlim_t{100000}, rlim_t{1200000}, rlim_t{1500000}}) {
    rlimit small = before;
    small.rlim_cur = limit;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    const absl::Status status = Run(v, options);
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("full.partial-")))
        << limit;
    EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty()) << limit;
  }
  std::signal(SIGXFSZ, old_handler);
}

TEST_F(PartitionerFailureTest, CancellationWhileIndexesAreBuiltLeavesNothing) {
  const Volume v = VolumeOfManyBlocks();
  PartitionOptions options = TwoShards(Options("cancelled"));
  options.block_cells = {1, 1, 1};
  base::Cancellation cancellation;
  options.progress = [&](const PartitionProgress& progress) {
    if (progress.phase == std::string("building index")) {
      cancellation.Cancel();
    }
  };
  EXPECT_THAT(Partition(*SourceOf(v), options, cancellation).status(),
              StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty());
}

TEST_F(PartitionerFailureTest, LeftoverOfAKilledRunDoesNotStopTheNextAndIsNoDataset) {
  const Volume v = LayeredVolume();
  PartitionOptions options = TwoShards(Options("set"));
  // The state in the middle of a run, copied while the run is in its last read.
  options.memory_limit_bytes = LeastLimit(*SourceOf(v), options);
  ScriptedSource counted(SourceOf(v), Proceed);
  ISOSCOPE_ASSERT_OK(Partition(counted, options, never_).status());
  std::filesystem::remove_all(options.output_directory);
  ScriptedSource source(SourceOf(v), [&](int read) {
    if (read == counted.read_count() - 1) {
      for (const auto& entry : std::filesystem::directory_iterator(dir_.path())) {
        std::filesystem::copy(entry.path(), dir_.Sub("leftover"),
                              std::filesystem::copy_options::recursive);
        break;
      }
    }
    return absl::OkStatus();
  });
  ISOSCOPE_ASSERT_OK(Partition(source, options, never_).status());
  std::filesystem::remove_all(options.output_directory);
  const std::string partial = dir_.Sub("set.partial-4711aa");
  std::filesystem::rename(dir_.Sub("leftover"), partial);
  EXPECT_FALSE(store::IsDatasetDirectory(partial));
  EXPECT_FALSE(store::OpenDataset(partial).ok());
  for (int shard = 0; shard < 2; ++shard) {
    EXPECT_FALSE(
        store::ShardReader::Open(absl::StrCat(partial, "/", store::ShardDirectoryName(shard, 2)))
            .ok());
  }
  ISOSCOPE_ASSERT_OK(Run(v, options));
  ExpectDatasetMatches(options.output_directory, v, options);
  EXPECT_THAT(EntriesOf(dir_.path()), ::testing::ElementsAre("set"));
}

// Symptom: a file that was written while it was read gave a volume of both.
TEST_F(PartitionerFailureTest, ASourceThatHasChangedMeanwhileLeavesNothing) {
  const Volume v = LayeredVolume();
  PartitionOptions options = TwoShards(Options("set"));
  options.check_source = [] { return absl::AbortedError("the file has changed"); };
  EXPECT_THAT(Partition(*SourceOf(v), options, never_).status(),
              StatusIs(absl::StatusCode::kAborted, HasSubstr("has changed")));
  EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty());
  int asked = 0;
  options.check_source = [&] {
    ++asked;
    return absl::OkStatus();
  };
  ISOSCOPE_ASSERT_OK(Run(v, options));
  EXPECT_EQ(asked, 1);
}

}  // namespace
}  // namespace isoscope::partition
