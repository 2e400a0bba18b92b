// The memory limit is split when the process starts, and the cache when its shards are open:
//
//   1/4          steps in work: ReserveStep waits until a step's bytes fit
//   1/16, 1/32   images and layers that wait for the next step
//   1/32         open volumes, if there are series
//   1/8, 1/64    units of sources, and indexes of their shards, if there are index-only shards
//   the rest     in use with the shards open, and trees and pages of large volumes; the cache gets
//                half of what is left, threads a quarter, and allocators and messages a quarter
//                (Settle); threads that need more get it from the cache
//
// A thread that draws takes memory beside the step's: scratch, a chunk of memory that it fills with
// meshes, and meshes on their way. So a small limit has small chunks, and room for few threads.
//
// A step's bytes are those of its pixels, and fixed shares for its meshes and reads. The shares get
// smaller with step_count, so that this many steps fit at a time.
//
// Example: of 1 GiB, all steps together have 256 MiB. A viewport of 1024 x 1024 without layers
// needs 32 bytes a pixel, 32 MiB, and the fixed shares.

#include "partition-agent/memory/agent_memory.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>

#include "absl/strings/str_format.h"
#include "oneapi/tbb/info.h"

#include "core/base/check.h"
#include "core/base/memory_info.h"
#include "core/base/memory_pool.h"
#include "core/base/units.h"
#include "core/store/shard_reader.h"
#include "core/store/volume_ranges.h"

namespace isoscope::agent {
namespace {

// Bytes of a pixel: 12 for the image (key and colour), 8 for the fragment while a pass draws, and
// 12 for bands while they are encoded and wait for the network.
constexpr std::size_t kStepBytesPerPixel = 12 + 8 + 12;
// For a translucent fragment of a pixel, 12 bytes are for key and colour, and 12 for its bands.
constexpr std::size_t kLayerBytesPerPixel = 12 + 12;
// The share of reads under way, and their maximum. More does not make a step faster.
constexpr std::size_t kReadShare = 32;
constexpr std::size_t kMaxReadBytes = 16 * base::kMiB;
static_assert(AgentMemory::kMinLimitBytes / kReadShare >=
                  static_cast<std::size_t>(store::ShardReader::kMaxDiskRunBytes),
              "a run of blocks is read at once");
// The caches get half of the remainder. Allocators, stacks and messages take the other half.
constexpr double kCacheShare = 0.5;
constexpr std::size_t kIdleImagesShare = 16;
constexpr std::size_t kIdleLayersShare = 32;
// The share of the limit without steps and idle images.
constexpr double kRestShare = 1.0 - 1.0 / 4 - 1.0 / kIdleImagesShare - 1.0 / kIdleLayersShare;
constexpr std::size_t kOpenVolumesShare = 32;           // of the limit, if there are series
constexpr std::size_t kMinCacheBytes = 8 * base::kMiB;  // with all that is left
constexpr std::size_t kLeastCacheBytes = 2 * base::kMiB;
// The most memory that is touched at start and ahead of frames: enough for some five million
// triangles. It takes milliseconds.
constexpr std::size_t kMaxPopulatedBytes = 128 * base::kMiB;

constexpr std::size_t kStepsShare = 4;  // of the limit
// The process of the next run may use this much more: pages of libraries, threads' stacks.
constexpr double kProcessVariance = 1.02;

// The program with small shards open. Measured: 45 MiB.
constexpr std::size_t kProgramBytes = 48 * base::kMiB;
// Shares of what is left for caches, threads and the rest of the process.
constexpr std::size_t kThreadsShare = 4;
// A thread's stack, malloc's lists of what it has freed, its buffers of fragments and of shading.
constexpr std::size_t kThreadFixedBytes = 256 * base::kKiB;
// Meshes on their way to the picture: MeshWorker::kMaxBatchBytes.
constexpr std::size_t kThreadBatchBytes = 256 * base::kKiB;
// The scratch of the extractor for each sample of a block: 16 for ids of vertices, 8 for those that
// a surface has, and 8 for the rasterizer's copies of them. Measured: 26, of a surface in noise.
constexpr std::size_t kScratchBytesPerSample = 32;
constexpr math::Index3 kUsualBlockCells{16, 16, 16};
// The chunks of memory that all threads fill with meshes are a 32nd of the limit. Smaller ones
// than the least waste much of their ends.
constexpr std::size_t kChunksShare = 32;
constexpr std::size_t kMinChunkBytes = 128 * base::kKiB;
constexpr int kMinThreads = 2;
// Each arena of malloc keeps what its threads have freed, and holes between what they hold. With 160
// MiB, a picture of an index-only dataset took 134 MiB with one arena, 150 with two, and with 14
// threads 146 with one and 193 with 14.
constexpr std::size_t kBytesPerMallocArena = 256 * base::kMiB;

double Mebibytes(std::size_t bytes) {
  return static_cast<double>(bytes) / static_cast<double>(base::kMiB);
}

std::size_t ReadBytesOf(std::size_t limit_bytes, std::size_t step_count) {
  return std::clamp(limit_bytes * AgentMemory::kDefaultStepCount / (kReadShare * step_count),
                    static_cast<std::size_t>(store::ShardReader::kMaxDiskRunBytes), kMaxReadBytes);
}

// With ghost samples.
std::int64_t StoredSamples(const math::Index3& block_cells) {
  return (block_cells.x + 3) * (block_cells.y + 3) * (block_cells.z + 3);
}

std::size_t ChunkBytesOf(std::size_t limit_bytes, std::size_t thread_count) {
  return std::clamp(std::bit_floor(limit_bytes / kChunksShare / thread_count), kMinChunkBytes,
                    base::MemoryPool::kChunkBytes);
}

std::size_t ThreadBytesOf(std::size_t limit_bytes, std::size_t thread_count,
                          std::int64_t block_samples) {
  return thread_count * (kThreadFixedBytes + kThreadBatchBytes +
                         kScratchBytesPerSample * static_cast<std::size_t>(block_samples) +
                         ChunkBytesOf(limit_bytes, thread_count));
}

// Returns the number of threads for which this limit has room.
int MostThreads(std::size_t limit_bytes) {
  const auto left = static_cast<std::size_t>(kRestShare * static_cast<double>(limit_bytes));
  const std::size_t bytes = (left - std::min(left, kProgramBytes)) / kThreadsShare;
  constexpr int kMost = 4096;
  int threads = kMinThreads;
  while (threads < kMost && ThreadBytesOf(limit_bytes, static_cast<std::size_t>(threads) + 1,
                                          StoredSamples(kUsualBlockCells)) <= bytes) {
    ++threads;
  }
  return threads;
}

std::size_t StepBytesOf(std::size_t limit_bytes, std::size_t step_count,
                        const view::Viewport& viewport, int max_layers) {
  const std::size_t pixels =
      static_cast<std::size_t>(viewport.width_px) * static_cast<std::size_t>(viewport.height_px);
  const std::size_t layer_bytes =
      max_layers == 0 ? 0 : static_cast<std::size_t>(max_layers + 1) * kLayerBytesPerPixel;
  return pixels * (kStepBytesPerPixel + layer_bytes) + limit_bytes / (8 * step_count) +
         ReadBytesOf(limit_bytes, step_count);
}

}  // namespace

std::size_t AgentMemory::DefaultLimitBytes() {
  return std::max<std::size_t>(base::UsableBytes() / 4, base::kGiB);
}

int AgentMemory::DrawingThreads(int thread_count, std::size_t limit_bytes) {
  return std::min(thread_count > 0 ? thread_count : oneapi::tbb::info::default_concurrency(),
                  MostThreads(limit_bytes));
}

std::shared_ptr<base::TaskArena> AgentMemory::MakeArena(int thread_count, std::size_t limit_bytes) {
  const int cores = oneapi::tbb::info::default_concurrency();
  base::LimitMallocArenas(static_cast<int>(std::clamp<std::size_t>(
      limit_bytes / kBytesPerMallocArena, 1, static_cast<std::size_t>(cores))));
  const int drawing = DrawingThreads(thread_count, limit_bytes);
  const bool have_all_room = drawing == (thread_count > 0 ? thread_count : cores);
  return std::make_shared<base::TaskArena>(have_all_room ? thread_count : drawing);
}

AgentMemory::AgentMemory(std::size_t limit_bytes, int step_count, int thread_count)
    : limit_bytes_(limit_bytes),
      step_count_(static_cast<std::size_t>(std::max(step_count, kDefaultStepCount))),
      thread_count_(static_cast<std::size_t>(thread_count)),
      open_volumes_(std::make_shared<OpenVolumes>(limit_bytes / kOpenVolumesShare)),
      steps_(limit_bytes / kStepsShare),
      cache_(0, base::MemoryPool::Make(ChunkBytesOf(limit_bytes, thread_count_))),
      layers_(unused_layer_bytes()) {
  ISOSCOPE_CHECK_GE(limit_bytes, kMinLimitBytes);
}

void AgentMemory::NoteBlocks(const math::Index3& block_cells) {
  const std::int64_t stored_samples = StoredSamples(block_cells);
  std::int64_t largest = block_samples_.load();
  while (largest < stored_samples &&
         !block_samples_.compare_exchange_weak(largest, stored_samples)) {
  }
}

std::size_t AgentMemory::ThreadBytes(std::size_t limit_bytes) const {
  const std::int64_t samples = block_samples_.load();
  return ThreadBytesOf(limit_bytes, thread_count_,
                       samples > 0 ? samples : StoredSamples(kUsualBlockCells));
}

std::size_t AgentMemory::ForFrames(std::size_t limit_bytes) const {
  return limit_bytes / kStepsShare + limit_bytes / kIdleImagesShare +
         limit_bytes / kIdleLayersShare +
         (has_series_.load() ? limit_bytes / kOpenVolumesShare : 0) +
         (has_source_.load() ? limit_bytes / kSourceShare + limit_bytes / kSourceIndexShare : 0);
}

std::size_t AgentMemory::read_bytes() const { return ReadBytesOf(limit_bytes_, step_count_); }

absl::Status AgentMemory::Settle(const std::optional<ExpectedStep>& expected, bool touches_ahead) {
  if (base::ResidentBytes() > limit_bytes_ / 4) {
    // The opening, and a partitioning before it, have freed memory. With less in use, frames use
    // it again instead.
    base::ReturnFreedMemory();
  }
  const std::size_t in_use = base::ResidentBytes() + store::VolumeRanges::LaterBytes();
  const auto cache_bytes_of = [&](std::size_t limit_bytes, std::size_t in_use_bytes) {
    const std::size_t taken = in_use_bytes + ForFrames(limit_bytes);
    if (taken + kMinCacheBytes > limit_bytes) {
      return std::size_t{0};
    }
    const std::size_t left = limit_bytes - taken;
    const std::size_t for_threads = ThreadBytes(limit_bytes);
    const std::size_t from_cache = for_threads - std::min(for_threads, left / kThreadsShare);
    const auto bytes = static_cast<std::size_t>(kCacheShare * static_cast<double>(left));
    return bytes - std::min(bytes, from_cache);
  };
  const std::size_t cache_bytes = cache_bytes_of(limit_bytes_, in_use);
  if (cache_bytes < kLeastCacheBytes) {
    // The next process may use a little more than this one.
    const auto next_in_use =
        static_cast<std::size_t>(kProcessVariance * static_cast<double>(in_use));
    std::size_t enough = limit_bytes_ / base::kMiB * base::kMiB;
    do {
      enough += base::kMiB;
    } while (cache_bytes_of(enough, next_in_use) < kLeastCacheBytes);
    if (expected.has_value()) {
      enough = std::max(enough, LeastLimitFor(expected->viewport, expected->max_layers,
                                              static_cast<int>(step_count_)));
    }
    const bool are_threads_too_many =
        in_use + ForFrames(limit_bytes_) + kMinCacheBytes <= limit_bytes_;
    const std::string threads =
        are_threads_too_many ? absl::StrFormat(", %.0f MiB for %d threads",
                                               Mebibytes(ThreadBytes(limit_bytes_)), thread_count_)
                             : "";
    return absl::FailedPreconditionError(absl::StrFormat(
        "the memory limit of %.0f MiB is too small: %.0f MiB are in use with the shards open%s and "
        "%.0f MiB are for frames; raise --memory-limit to %.0fMiB, or %s",
        Mebibytes(limit_bytes_), Mebibytes(in_use), threads, Mebibytes(ForFrames(limit_bytes_)),
        Mebibytes(enough), are_threads_too_many ? "use fewer --threads" : "serve fewer shards"));
  }
  cache_.SetMaxBytes(cache_bytes);
  if (!touches_ahead) {
    return absl::OkStatus();
  }
  const std::size_t ahead_bytes = std::min(cache_bytes / 2, kMaxPopulatedBytes);
  cache_.Populate(ahead_bytes);
  toucher_ = std::make_unique<IdleToucher>(IdleToucher::Options{
      .is_busy = [this] { return steps_.reserved_bytes() > 0; },
      .touch_some = [this, ahead_bytes] { return cache_.PopulateAhead(ahead_bytes); }});
  return absl::OkStatus();
}

std::size_t AgentMemory::StepBytes(const view::Viewport& viewport, int max_layers) const {
  return StepBytesOf(limit_bytes_, step_count_, viewport, max_layers);
}

std::size_t AgentMemory::LeastLimitFor(const view::Viewport& viewport, int max_layers,
                                       int step_count) {
  const auto steps = static_cast<std::size_t>(std::max(step_count, kDefaultStepCount));
  // Searches whole MiB: what a step needs grows more slowly than its share.
  std::size_t too_small = kMinLimitBytes / base::kMiB - 1;
  std::size_t enough = std::size_t{1} << 30;  // a PiB
  while (enough - too_small > 1) {
    const std::size_t middle = too_small + (enough - too_small) / 2;
    const std::size_t limit = middle * base::kMiB;
    const bool fits = StepBytesOf(limit, steps, viewport, max_layers) <= limit / kStepsShare;
    (fits ? enough : too_small) = middle;
  }
  return enough * base::kMiB;
}

std::size_t AgentMemory::RoomFor(const view::Viewport& viewport, int max_layers) const {
  return steps_.capacity_bytes() / StepBytes(viewport, max_layers);
}

AgentMemory::AheadThreads AgentMemory::TakeAheadThreads() {
  const base::MutexLock lock(&ahead_mutex_);
  if (ahead_threads_.reading == nullptr) {
    // The agents bound their tasks.
    constexpr std::size_t kMaxQueued = std::numeric_limits<std::size_t>::max();
    ahead_threads_ = {.reading = std::make_shared<base::Executor>(1, kMaxQueued),
                      .making = std::make_shared<base::Executor>(1, kMaxQueued)};
  }
  return ahead_threads_;
}

absl::StatusOr<base::MemoryBudget::Reservation> AgentMemory::ReserveStep(
    const view::Viewport& viewport, const base::Cancellation& cancellation, int max_layers) {
  if (toucher_ != nullptr) {
    toucher_->NoteWork();
  }
  const std::size_t bytes = StepBytes(viewport, max_layers);
  absl::StatusOr<base::MemoryBudget::Reservation> reservation = steps_.Reserve(bytes, cancellation);
  if (absl::IsResourceExhausted(reservation.status())) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a viewport of %d x %d pixels needs %.0f MiB while it is drawn; with the memory limit of "
        "%.0f MiB at most %.0f MiB may be used: ask for a smaller viewport%s or raise "
        "--memory-limit to %.0fMiB",
        viewport.width_px, viewport.height_px, Mebibytes(bytes), Mebibytes(limit_bytes_),
        Mebibytes(steps_.capacity_bytes()), max_layers > 0 ? ", for fewer max_layers" : "",
        Mebibytes(LeastLimitFor(viewport, max_layers, static_cast<int>(step_count_)))));
  }
  return reservation;
}

}  // namespace isoscope::agent
