#include "partition-agent/memory/queued_reads.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/render/renderer_factory.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

// Makes the system drop its cached pages of a file, if it can.
void DropFromMemory(const std::string& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_GE(descriptor, 0);
  ASSERT_EQ(fdatasync(descriptor), 0);
  ASSERT_EQ(posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED), 0);
  ASSERT_EQ(close(descriptor), 0);
}

absl::StatusOr<ArrivalWork> DoneIf(const absl::Status& status) {
  return status.ok() ? absl::StatusOr<ArrivalWork>(ArrivalWork::kDone) : status;
}

class QueuedReadsTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::string BlocksPath() const {
    return dataset_.shard_directory(0) + "/" + store::kBlocksFileName;
  }
  // With nothing in the agent's cache.
  absl::StatusOr<image::FrameImage> RenderAll(const Shards& shards) {
    BlockCache cache(std::size_t{1} << 28);
    ISOSCOPE_ASSIGN_OR_RETURN(const auto renderer,
                              render::MakeRenderer({.kind = render::RendererKind::kCpu}));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const auto pipeline,
        FramePipeline::Make(shards, dataset_.Request(),
                            {.renderer = renderer.get(), .arena = &arena_, .cache = &cache},
                            &never_));
    return pipeline->RenderAll();
  }

  const SmallDataset dataset_{1};
  base::TaskArena arena_{2};
  const base::Cancellation never_;
};

TEST_F(QueuedReadsTest, EveryReadIsWorkedOnOnceAndAnErrorStopsTheRest) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, io::OpenRandomAccessFile(BlocksPath()));
  const std::vector<io::ReadQueue::Read> reads(500, {file.get(), 7, 100});
  {
    io::ReadQueue queue(reads);
    base::Mutex mutex;
    std::multiset<std::size_t> seen;
    ISOSCOPE_ASSERT_OK(
        ForEachArrival(&queue, &arena_, never_, [&](const io::ReadQueue::Arrival& arrival) {
          const base::MutexLock lock(&mutex);
          seen.insert(arrival.index());
          return DoneIf(arrival.status());
        }));
    EXPECT_EQ(seen.size(), 500U);
    EXPECT_EQ(std::set<std::size_t>(seen.begin(), seen.end()).size(), 500U);
  }
  // One thread: another could work on any number before this one has said that it failed.
  base::TaskArena alone(1);
  io::ReadQueue queue(reads);
  std::atomic<int> count{0};
  EXPECT_THAT(ForEachArrival(&queue, &alone, never_,
                             [&](const io::ReadQueue::Arrival&) {
                               return DoneIf(++count == 3 ? absl::DataLossError("the third")
                                                          : absl::OkStatus());
                             }),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the third")));
  EXPECT_LT(count, 10);

  base::Cancellation cancellation;
  io::ReadQueue cancelled(reads);
  count = 0;
  EXPECT_THAT(ForEachArrival(&cancelled, &alone, cancellation,
                             [&](const io::ReadQueue::Arrival&) {
                               if (++count == 3) {
                                 cancellation.Cancel();
                               }
                               return DoneIf(absl::OkStatus());
                             }),
              StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_LT(count, 10);
}

TEST_F(QueuedReadsTest, ColdAndWarmFramesOfBothBackendsAreOnePicture) {
  const auto shards = dataset_.OpenShards();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage expected, RenderAll(shards));
  for (const char* backend : {"io_uring", "threads"}) {
    ASSERT_EQ(setenv("ISOSCOPE_READ_BACKEND", backend, 1), 0);
    ASSERT_NO_FATAL_FAILURE(DropFromMemory(BlocksPath()));
    for (int i = 0; i < 2; ++i) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAll(shards));
      EXPECT_TRUE(image == expected) << backend;
    }
  }
  ASSERT_EQ(unsetenv("ISOSCOPE_READ_BACKEND"), 0);
}

TEST_F(QueuedReadsTest, ShardReplacedByAnotherLeavesOpenOnesTheirPicture) {
  const auto shards = dataset_.OpenShards();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage expected, RenderAll(shards));
  // As a careful copy does: a new file in the place of the old one.
  const std::string bytes = io::ReadWholeFile(BlocksPath(), base::kGiB).value();
  const std::string copy = BlocksPath() + ".new";
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(copy, std::string(bytes.size(), 'z')));
  ISOSCOPE_ASSERT_OK(io::RenamePath(copy, BlocksPath()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage after_replacement, RenderAll(shards));
  EXPECT_TRUE(after_replacement == expected);
  std::filesystem::remove_all(dataset_.directory());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage after_removal, RenderAll(shards));
  EXPECT_TRUE(after_removal == expected);
}

TEST_F(QueuedReadsTest, ShardOverwrittenInPlaceIsDataLossAndNeverAnotherPicture) {
  const auto shards = dataset_.OpenShards();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage expected, RenderAll(shards));
  const std::string bytes = io::ReadWholeFile(BlocksPath(), base::kGiB).value();
  const auto overwrite = [&](const std::string& with) {
    std::ofstream(BlocksPath(), std::ios::binary | std::ios::trunc) << with;
  };
  for (const char* backend : {"io_uring", "threads"}) {
    ASSERT_EQ(setenv("ISOSCOPE_READ_BACKEND", backend, 1), 0);
    overwrite(std::string(bytes.size(), 'z'));
    for (int i = 0; i < 2; ++i) {
      EXPECT_THAT(RenderAll(shards), StatusIs(absl::StatusCode::kDataLoss,
                                              AllOf(HasSubstr("shard 0 of 1: block "),
                                                    HasSubstr(BlocksPath()), HasSubstr("crc32c"))));
      ASSERT_NO_FATAL_FAILURE(DropFromMemory(BlocksPath()));
    }
    overwrite(bytes.substr(0, bytes.size() / 2));
    EXPECT_THAT(RenderAll(shards),
                StatusIs(absl::StatusCode::kDataLoss,
                         HasSubstr("ends after " + std::to_string(bytes.size() / 2) + " bytes")));
    overwrite(bytes);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAll(shards));
    EXPECT_TRUE(image == expected);
  }
  ASSERT_EQ(unsetenv("ISOSCOPE_READ_BACKEND"), 0);
}

}  // namespace
}  // namespace isoscope::agent
