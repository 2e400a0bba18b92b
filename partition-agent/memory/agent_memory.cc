// The memory limit is split when the process starts, and the cache when its shards are open:
//
//   1/4          steps in work: ReserveStep waits until a step's bytes fit
//   1/16, 1/32   images and layers that wait for the next step
//   1/32         open volumes, if there are series
//   1/8          units of sources, if there are index-only shards
//   the rest     in use with the shards open, and trees and pages of large volumes; the cache gets
//                half of what is left, and allocators, stacks and messages the other half (Settle)
//
// A step's bytes are those of its pixels, and fixed shares for its meshes and reads. The shares get
// smaller with step_count, so that this many steps fit at a time.
//
// Example: of 1 GiB, all steps together have 256 MiB. A viewport of 1024 x 1024 without layers
// needs 32 bytes a pixel, 32 MiB, and the fixed shares.

#include "partition-agent/memory/agent_memory.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/memory_info.h"
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
// The share of the limit without steps and idle images.
constexpr double kRestShare = 1.0 - 1.0 / 4 - 1.0 / 16 - 1.0 / 32;
constexpr std::size_t kOpenVolumesShare = 32;  // of the limit, if there are series
constexpr std::size_t kMinCacheBytes = 8 * base::kMiB;
// The most memory that is touched at start and ahead of frames: enough for some five million
// triangles. It takes milliseconds.
constexpr std::size_t kMaxPopulatedBytes = 128 * base::kMiB;

constexpr std::size_t kStepsShare = 4;  // of the limit
// The process of the next run may use this much more: pages of libraries, threads' stacks.
constexpr double kProcessVariance = 1.02;

double Mebibytes(std::size_t bytes) {
  return static_cast<double>(bytes) / static_cast<double>(base::kMiB);
}

std::size_t ReadBytesOf(std::size_t limit_bytes, std::size_t step_count) {
  return std::clamp(limit_bytes * AgentMemory::kDefaultStepCount / (kReadShare * step_count),
                    static_cast<std::size_t>(store::ShardReader::kMaxDiskRunBytes), kMaxReadBytes);
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

AgentMemory::AgentMemory(std::size_t limit_bytes, int step_count)
    : limit_bytes_(limit_bytes),
      step_count_(static_cast<std::size_t>(std::max(step_count, kDefaultStepCount))),
      open_volumes_(std::make_shared<OpenVolumes>(limit_bytes / kOpenVolumesShare)),
      steps_(limit_bytes / kStepsShare),
      cache_(0),
      layers_(unused_layer_bytes()) {
  ISOSCOPE_CHECK_GE(limit_bytes, kMinLimitBytes);
}

std::size_t AgentMemory::read_bytes() const { return ReadBytesOf(limit_bytes_, step_count_); }

absl::Status AgentMemory::Settle(const std::optional<ExpectedStep>& expected, bool touches_ahead) {
  if (base::ResidentBytes() > limit_bytes_ / 4) {
    // The opening, and a partitioning before it, have freed memory. With less in use, frames use
    // it again instead.
    base::ReturnFreedMemory();
  }
  const std::size_t in_use = base::ResidentBytes() + store::VolumeRanges::LaterBytes();
  const double rest_share = kRestShare - (has_series_.load() ? 1.0 / kOpenVolumesShare : 0.0) -
                            (has_source_.load() ? 1.0 / kSourceShare : 0.0);
  const std::size_t for_frames = steps_.capacity_bytes() + unused_image_bytes() +
                                 unused_layer_bytes() +
                                 (has_series_.load() ? limit_bytes_ / kOpenVolumesShare : 0) +
                                 (has_source_.load() ? source_bytes() : 0);
  const std::size_t taken = in_use + for_frames;
  if (taken + kMinCacheBytes > limit_bytes_) {
    // The next process may use a little more than this one.
    const double next_in_use = kProcessVariance * static_cast<double>(in_use);
    double enough = std::ceil((next_in_use + static_cast<double>(kMinCacheBytes)) /
                              (rest_share * double{base::kMiB}));
    if (expected.has_value()) {
      enough = std::max(enough, Mebibytes(LeastLimitFor(expected->viewport, expected->max_layers,
                                                        static_cast<int>(step_count_))));
    }
    return absl::FailedPreconditionError(absl::StrFormat(
        "the memory limit of %.0f MiB is too small: %.0f MiB are in use with the shards open and "
        "%.0f MiB are for frames; raise --memory-limit to %.0fMiB, or serve fewer shards",
        Mebibytes(limit_bytes_), Mebibytes(in_use), Mebibytes(for_frames), enough));
  }
  const auto cache_bytes =
      static_cast<std::size_t>(kCacheShare * static_cast<double>(limit_bytes_ - taken));
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
