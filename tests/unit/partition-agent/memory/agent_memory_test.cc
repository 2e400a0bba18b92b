#include "partition-agent/memory/agent_memory.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <thread>

#include "absl/strings/numbers.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/memory_info.h"
#include "core/base/memory_pool.h"
#include "core/base/monotonic_time.h"
#include "core/store/shard_reader.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kMiB = std::size_t{1} << 20;

// Room for what the process holds already, sanitizers' tables too.
std::size_t AmpleLimit() { return 2 * base::ResidentBytes() + 256 * kMiB; }

// The whole number that ends before `end` in `text`, or begins after `begin`; "" if there is none.
std::string NumberBefore(absl::string_view text, absl::string_view end) {
  const absl::string_view head = text.substr(0, text.find(end));
  const std::size_t begin = head.find_last_not_of("0123456789");
  return std::string(head.substr(begin == absl::string_view::npos ? 0 : begin + 1));
}
std::string NumberAfter(absl::string_view text, absl::string_view begin) {
  const std::size_t found = text.find(begin);
  if (found == absl::string_view::npos) {
    return "";
  }
  const absl::string_view tail = text.substr(found + begin.size());
  return std::string(tail.substr(0, tail.find_first_not_of("0123456789")));
}

TEST(AgentMemoryTest, DefaultLimitIsAQuarterOfTheMachineButNotTooLittle) {
  EXPECT_GE(AgentMemory::DefaultLimitBytes(), 1024 * kMiB);
  EXPECT_GE(AgentMemory::DefaultLimitBytes(), base::UsableBytes() / 4);
  EXPECT_GE(AgentMemory::DefaultLimitBytes(), AgentMemory::kMinLimitBytes);
}

TEST(AgentMemoryTest, CacheKeepsNothingBeforeSettleAndWithinTheLimitAfterIt) {
  const SmallDataset dataset(1);
  const auto shards = dataset.OpenShards();
  const Shard& shard = *shards.front();
  const std::size_t in_use = base::ResidentBytes();
  const std::size_t limit = AmpleLimit();
  AgentMemory memory(limit);
  BlockCache* const cache = memory.cache();
  const std::string samples(1331, 's');
  for (int i = 0; i < 3; ++i) {
    cache->OfferSamples(shard, 0, samples);
  }
  EXPECT_EQ(cache->FindSamples(shard, 0), nullptr);
  EXPECT_EQ(cache->size_bytes(), 0U);

  ISOSCOPE_ASSERT_OK(memory.Settle());
  cache->OfferSamples(shard, 0, samples);
  ASSERT_NE(cache->FindSamples(shard, 0), nullptr);
  EXPECT_EQ(*cache->FindSamples(shard, 0), samples);
  // Meshes up to the brim: caches, frames and images together stay below the limit.
  const std::uint64_t round = cache->BeginRound(1);
  const auto table = cache->meshes()->TableOf(shard.number, {.isovalue = 1}, 100'000);
  mesh::BlockMesh mesh;
  mesh.positions.resize(20'000);
  mesh.normals.resize(20'000);
  MeshCache::Writer writer(cache->meshes(), round);
  for (std::size_t place = 0; place < limit / mesh.size_bytes(); ++place) {
    writer.Store(mesh, table.get(), place);
  }
  EXPECT_GT(cache->size_bytes(), 32 * kMiB);
  EXPECT_LT(in_use + cache->size_bytes() + memory.unused_image_bytes() + limit / 4, limit);
}

// What is touched takes time, which pays from the second frame on.
TEST(AgentMemoryTest, MemoryIsTouchedAheadOfFramesUnlessThereIsOne) {
  const std::size_t limit = AmpleLimit();
  AgentMemory once(limit);
  const std::size_t before = base::ResidentBytes();
  ISOSCOPE_ASSERT_OK(once.Settle(std::nullopt, /*touches_ahead=*/false));
  EXPECT_LT(base::ResidentBytes(), before + kMiB);
  AgentMemory often(limit);
  ISOSCOPE_ASSERT_OK(often.Settle());
  EXPECT_GT(base::ResidentBytes(), before + 16 * kMiB);
}

TEST(AgentMemoryTest, TooSmallALimitSaysWhatIsInUseAndWhatWouldDo) {
  // More than what is left of the least limit once frames have their share.
  const auto pool = base::MemoryPool::Make();
  pool->Populate(AgentMemory::kMinLimitBytes);
  AgentMemory memory(AgentMemory::kMinLimitBytes);
  const absl::Status status = memory.Settle();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kFailedPrecondition,
                               AllOf(HasSubstr("the memory limit of 96 MiB is too small"),
                                     HasSubstr(" MiB are in use with the shards open"),
                                     HasSubstr("33 MiB are for frames"),
                                     HasSubstr("raise --memory-limit"))));
  int in_use_mib = 0;
  int enough_mib = 0;
  ASSERT_TRUE(absl::SimpleAtoi(NumberBefore(status.message(), " MiB are in use"), &in_use_mib));
  EXPECT_GE(in_use_mib, 96);
  EXPECT_LE(in_use_mib, static_cast<int>(base::ResidentBytes() / kMiB) + 16);
  // Following the advice helps, and less would not.
  ASSERT_TRUE(absl::SimpleAtoi(NumberAfter(status.message(), "--memory-limit to "), &enough_mib))
      << status;
  EXPECT_THAT(AgentMemory(static_cast<std::size_t>(enough_mib + 8) * kMiB).Settle(), IsOk());
  EXPECT_THAT(AgentMemory(static_cast<std::size_t>(enough_mib - 8) * kMiB).Settle(),
              StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(AgentMemoryTest, ReadsUnderWayAreAShareOfTheLimitBetweenOneRunAndWhatPays) {
  EXPECT_EQ(AgentMemory(AgentMemory::kMinLimitBytes).read_bytes(), 3 * kMiB);
  EXPECT_GE(AgentMemory(AgentMemory::kMinLimitBytes).read_bytes(),
            static_cast<std::size_t>(store::ShardReader::kMaxDiskRunBytes));
  EXPECT_EQ(AgentMemory(256 * kMiB).read_bytes(), 8 * kMiB);
  EXPECT_EQ(AgentMemory(512 * kMiB).read_bytes(), 16 * kMiB);
  EXPECT_EQ(AgentMemory(4096 * kMiB).read_bytes(), 16 * kMiB);
}

TEST(AgentMemoryTest, ReadsUnderWayAreReservedWithTheirStep) {
  // The steps have 24 MiB: 6 for meshes, 3 for reads, and 15 MiB at 32 bytes a pixel.
  AgentMemory memory(AgentMemory::kMinLimitBytes);
  const base::Cancellation never;
  EXPECT_THAT(memory.ReserveStep({960, 512}, never), IsOk());
  EXPECT_THAT(memory.ReserveStep({961, 512}, never),
              StatusIs(absl::StatusCode::kResourceExhausted));
}

TEST(AgentMemoryTest, ManyStepsAtATimeHaveRoomForAsManyThreads) {
  for (const int step_count : {2, 3, 4, 8, 64, 128}) {
    const AgentMemory memory(std::size_t{64} << 30, step_count);
    EXPECT_GE(memory.RoomFor({1024, 1024}, /*max_layers=*/0), static_cast<std::size_t>(step_count));
    EXPECT_GE(memory.read_bytes(), static_cast<std::size_t>(store::ShardReader::kMaxDiskRunBytes));
  }
}

TEST(AgentMemoryTest, RoomForStepsIsWhatCanBeReserved) {
  AgentMemory memory(1024 * kMiB, 8);
  const base::Cancellation never;
  const std::size_t room = memory.RoomFor({512, 512}, 2);
  std::vector<base::MemoryBudget::Reservation> steps;
  for (std::size_t i = 0; i < room; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto reserved, memory.ReserveStep({512, 512}, never, 2));
    steps.push_back(std::move(reserved));
  }
  const base::Cancellation soon(base::MonotonicNow());
  EXPECT_THAT(memory.ReserveStep({512, 512}, soon, 2),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
}

TEST(AgentMemoryTest, ViewportTooLargeForTheLimitIsRefusedWithTheFigures) {
  AgentMemory memory(AgentMemory::kMinLimitBytes);
  const base::Cancellation never;
  EXPECT_THAT(memory.ReserveStep({640, 480}, never), IsOk());
  EXPECT_THAT(
      memory.ReserveStep({1024, 1024}, never),
      StatusIs(absl::StatusCode::kResourceExhausted,
               "a viewport of 1024 x 1024 pixels needs 41 MiB while it is drawn; with the memory "
               "limit of 96 MiB at most 24 MiB may be used: ask for a smaller viewport or raise "
               "--memory-limit to 205MiB"));
  EXPECT_THAT(memory.ReserveStep({1 << 20, 1 << 20}, never),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       HasSubstr("a viewport of 1048576 x 1048576 pixels needs")));
  EXPECT_THAT(AgentMemory(1024 * kMiB).ReserveStep({1024, 1024}, never), IsOk());
}

// The number of a refusal is the least that works, for any frame and number of steps.
TEST(AgentMemoryTest, TheLimitThatARefusedStepNamesIsEnoughAndOneLessIsNot) {
  const base::Cancellation never;
  for (const int step_count : {1, 2, 8, 64}) {
    for (const int max_layers : {0, 1, 8, 32}) {
      for (const view::Viewport& viewport :
           {view::Viewport{1, 1}, view::Viewport{1024, 1024}, view::Viewport{3840, 2160},
            view::Viewport{16384, 16384}}) {
        const std::size_t enough = AgentMemory::LeastLimitFor(viewport, max_layers, step_count);
        AgentMemory fits(enough, step_count);
        EXPECT_THAT(fits.ReserveStep(viewport, never, max_layers), IsOk())
            << viewport.width_px << " " << max_layers << " " << step_count;
        if (enough == AgentMemory::kMinLimitBytes) {
          continue;
        }
        AgentMemory small(enough - kMiB, step_count);
        const absl::Status refused = small.ReserveStep(viewport, never, max_layers).status();
        int named = 0;
        ASSERT_TRUE(absl::SimpleAtoi(NumberAfter(refused.message(), "--memory-limit to "), &named))
            << refused;
        EXPECT_EQ(static_cast<std::size_t>(named) * kMiB, enough);
      }
    }
  }
}

// Symptom: a render that was refused at the start for its shards named a limit at which it was then
// refused for its picture.
TEST(AgentMemoryTest, TheLimitThatSettleNamesIsEnoughForTheExpectedFrame) {
  const auto pool = base::MemoryPool::Make();
  pool->Populate(AgentMemory::kMinLimitBytes);
  AgentMemory memory(AgentMemory::kMinLimitBytes);
  const AgentMemory::ExpectedStep expected{.viewport = {2048, 2048}, .max_layers = 4};
  const absl::Status status = memory.Settle(expected);
  int named = 0;
  ASSERT_TRUE(absl::SimpleAtoi(NumberAfter(status.message(), "--memory-limit to "), &named))
      << status;
  EXPECT_EQ(static_cast<std::size_t>(named) * kMiB,
            AgentMemory::LeastLimitFor(expected.viewport, expected.max_layers,
                                       AgentMemory::kDefaultStepCount));
}

// Symptom: with --threads 64 a picture took 245 MiB of a limit of 160.
TEST(AgentMemoryTest, ASmallLimitHasFewThreadsAndALargeOneAllThatAreAskedFor) {
  EXPECT_EQ(AgentMemory::MakeArena(2, AgentMemory::kMinLimitBytes)->max_concurrency(), 2);
  const int with_160_mib = AgentMemory::MakeArena(64, 160 * kMiB)->max_concurrency();
  EXPECT_GE(with_160_mib, 8);
  EXPECT_LE(with_160_mib, 20);
  EXPECT_LT(AgentMemory::MakeArena(64, AgentMemory::kMinLimitBytes)->max_concurrency(),
            with_160_mib);
  EXPECT_EQ(AgentMemory::MakeArena(64, 1024 * kMiB)->max_concurrency(), 64);
}

TEST(AgentMemoryTest, ManyThreadsHaveSmallerChunksForMeshes) {
  // What a thread takes first is what its first mesh takes.
  const auto first_bytes = [](std::size_t limit_bytes, int thread_count) {
    AgentMemory memory(limit_bytes, AgentMemory::kDefaultStepCount, thread_count);
    BlockCache* const cache = memory.cache();
    cache->SetMaxBytes(64 * kMiB);
    const auto table = cache->meshes()->TableOf(0, {.isovalue = 1}, 1);
    const std::size_t before = cache->meshes()->size_bytes();
    mesh::BlockMesh mesh;
    mesh.positions.resize(4);
    mesh.normals.resize(4);
    MeshCache::Writer(cache->meshes(), cache->BeginRound(1)).Store(mesh, table.get(), 0);
    return cache->meshes()->size_bytes() - before;
  };
  EXPECT_EQ(first_bytes(160 * kMiB, 2), kMiB);
  EXPECT_EQ(first_bytes(160 * kMiB, 14), kMiB / 4);
  EXPECT_EQ(first_bytes(1024 * kMiB, 14), kMiB);
}

TEST(AgentMemoryTest, ThreadsWithLargeBlocksTakeFromTheCacheOrAreRefusedByName) {
  const std::size_t limit = AmpleLimit();
  AgentMemory few(limit, AgentMemory::kDefaultStepCount, 2);
  few.NoteBlocks({16, 16, 16});
  ISOSCOPE_ASSERT_OK(few.Settle());
  AgentMemory many(limit, AgentMemory::kDefaultStepCount, 1000);
  many.NoteBlocks({16, 16, 16});
  many.NoteBlocks({128, 128, 128});  // 69 MiB of scratch each
  const absl::Status status = many.Settle();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kFailedPrecondition,
                               AllOf(HasSubstr(" MiB for 1000 threads"),
                                     HasSubstr("use fewer --threads"))));
  int enough_mib = 0;
  ASSERT_TRUE(absl::SimpleAtoi(NumberAfter(status.message(), "--memory-limit to "), &enough_mib));
  AgentMemory enough(static_cast<std::size_t>(enough_mib) * kMiB, AgentMemory::kDefaultStepCount,
                     1000);
  enough.NoteBlocks({128, 128, 128});
  ISOSCOPE_EXPECT_OK(enough.Settle());
}

// Units and indexes of sources are memory of the process, so the cache gets less.
TEST(AgentMemoryTest, WithSourcesTheCacheLeavesRoomForUnitsAndIndexes) {
  constexpr std::size_t kLimit = std::size_t{8192} * kMiB;
  AgentMemory without(kLimit);
  AgentMemory with(kLimit);
  with.NoteSource();
  ISOSCOPE_ASSERT_OK(without.Settle(std::nullopt, /*touches_ahead=*/false));
  ISOSCOPE_ASSERT_OK(with.Settle(std::nullopt, /*touches_ahead=*/false));
  EXPECT_GT(with.source_index_bytes(), 100 * kMiB);
  const auto room = static_cast<double>(with.source_bytes() + with.source_index_bytes());
  const auto less = static_cast<double>(without.cache()->meshes()->max_bytes() -
                                        with.cache()->meshes()->max_bytes());
  EXPECT_NEAR(less, room / 2 * 11 / 16, 8 * kMiB);  // half of what is left, most for meshes
}

TEST(AgentMemoryTest, StepsWaitForEachOtherAndCanBeCancelled) {
  AgentMemory memory(AgentMemory::kMinLimitBytes);
  const base::Cancellation never;
  std::unique_ptr<base::MemoryBudget::Reservation> first;
  first = std::make_unique<base::MemoryBudget::Reservation>(*memory.ReserveStep({700, 700}, never));
  const base::Cancellation soon(base::MonotonicNow() + absl::Milliseconds(30));
  EXPECT_THAT(memory.ReserveStep({700, 700}, soon), StatusIs(absl::StatusCode::kDeadlineExceeded));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(memory.ReserveStep({700, 700}, cancelled), StatusIs(absl::StatusCode::kCancelled));
  absl::Notification is_reserved;
  std::thread second([&] {
    EXPECT_THAT(memory.ReserveStep({700, 700}, never), IsOk());
    is_reserved.Notify();
  });
  EXPECT_FALSE(is_reserved.WaitForNotificationWithTimeout(absl::Milliseconds(50)));
  first.reset();
  second.join();
}

}  // namespace
}  // namespace isoscope::agent
