// The limit is divided into shares:
//
//   9/16   frames, with their traces
//   1/8    exports; at least 24 MiB
//   1/32   pixels between the tiles of pictures; at least 6 MiB
//   3/32   images between frames: what pixels of tiles leave of 1/8; at most 384 MiB
//   1/16   active blocks between frames; at most 64 MiB
//   1/8    the process and gRPC
//
// A frame is drawn at once if it fits the share of frames, one view and the agents of this process.
// Else it is drawn in bands. A band takes at most 3/4 of what the answer leaves of the share,
// because the end of one band overlaps with the begin of the next: allocators return memory late.
// The same 3/4 hold for agents of this process. So the rest is for frames of other callers, too.
// Beside agents of this process, answer and bands have 5/8 of the limit less 64 MiB: the agents have
// 1/4 for a step and keep 1/8 as images, and the program and its libraries are some 64 MiB.
// All frames in work together have that much, too, and one that needs more is drawn alone.
// Planes and raw pictures lie beside the agents, and a client of this process may still hold the
// last ones. So agents get bands as if the limit were smaller by both, unless none fits then.
//
// ReserveFrame does not know the dataset yet, and takes 1 MiB for the sets of drawn blocks. Those of
// a larger dataset make the bands smaller, so that both stay within what was taken. Only a frame
// that already takes the least bands may exceed it, by these sets.
//
// A frame that neither way fits is refused. The limit that the refusal names is the least with
// which the smallest band fits. So is one whose smallest band is too large for the agents of this
// process, as far as bands help them: those that draw with OpenGL say themselves what they lack.

#include "server/admission/coordinator_memory.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/frame/drawn_window.h"

namespace isoscope::server {
namespace {

// Eight images of 2048 x 2048 pixels, or two frames of 1024 x 1024 with all their layers.
constexpr std::size_t kMaxUnusedImageBytes = 384 * base::kMiB;
// 4 bytes a block.
constexpr std::size_t kMaxActiveBlocksBytes = 64 * base::kMiB;
// For an export, from each agent: data that gRPC has read ahead (rpc::MakeExportChannel), a message
// of 256 KiB encoded and decoded, and a block made of it.
constexpr std::size_t kExportBytesPerAgent = base::kMiB;
// Shares of the limit; the rest is for the process itself and for gRPC.
constexpr std::size_t kFrameShare = 16;       // 9 of 16
constexpr std::size_t kExportShare = 8;       // 1 of 8, at least an export of eight agents
constexpr std::size_t kUnusedImageShare = 8;  // 1 of 8
constexpr std::size_t kActiveBlocksShare = 16;
constexpr std::size_t kTilesShare = 32;                 // out of that of unused images
constexpr std::size_t kMinTilesBytes = 6 * base::kMiB;  // 1024 x 1024 pixels, and sets of blocks
constexpr std::size_t kProgramBytes = 64 * base::kMiB;
constexpr std::size_t kTraceShare = 8;  // of one frame, out of the frames' share
constexpr std::size_t kMaxTraceBytes = 32 * base::kMiB;
// The sets of blocks that a frame in bands has drawn, as far as its dataset is not known: those of
// more than two million blocks.
constexpr std::size_t kCountingBytes = base::kMiB;
// The share of what is free that a band takes.
std::size_t BandShareOf(std::size_t bytes) { return bytes / 4 * 3; }

// Bytes for the answer and the bands of a frame beside agents of the same process. An eighth lets
// small pictures be drawn with the least limits.
std::size_t BytesBesideAgents(std::size_t limit_bytes) {
  const std::size_t left = limit_bytes / 8 * 5;
  return std::max(left - std::min(left, kProgramBytes), limit_bytes / 8);
}

std::size_t TilesBytesOf(std::size_t limit_bytes) {
  return std::max(limit_bytes / kTilesShare, kMinTilesBytes);
}

// The share of frames.
std::size_t FrameCapacity(std::size_t limit_bytes) { return limit_bytes / kFrameShare * 9; }

std::size_t TraceBytesOf(std::size_t limit_bytes) {
  return std::min(limit_bytes / kTraceShare, kMaxTraceBytes);
}

std::size_t TraceBytesOf(std::size_t limit_bytes, const FrameWish& wish) {
  return wish.has_trace ? TraceBytesOf(limit_bytes) : 0;
}

// The least limit, in whole MiB, for which `fits` is true, as it is for all larger ones.
std::size_t LeastLimit(absl::FunctionRef<bool(std::size_t limit_bytes)> fits) {
  std::size_t too_small = 0;
  std::size_t enough = std::size_t{1} << 30;  // a PiB
  while (enough - too_small > 1) {
    const std::size_t middle = too_small + (enough - too_small) / 2;
    (fits(middle * base::kMiB) ? enough : too_small) = middle;
  }
  return enough * base::kMiB;
}

// The frame with its region in the middle, where it has margins on all sides. A large picture is
// asked for region by region, and the first one lies in a corner.
frame::FrameSpec WithAllMargins(const frame::FrameSpec& spec) {
  return spec.region.has_value() ? BandInTheMiddle(spec, frame::ImageSizeOf(spec)) : spec;
}

std::size_t DrawnPixelsOf(const frame::FrameSpec& spec) {
  const view::Viewport drawn = frame::DrawnWindowOf(spec).image_size();
  return static_cast<std::size_t>(drawn.width_px) * static_cast<std::size_t>(drawn.height_px);
}

// The bytes of planes and raw pictures, which fill memory from the first band on.
std::size_t RawBytesOf(const frame::FrameSpec& spec) {
  const view::Viewport size = frame::ImageSizeOf(spec);
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px) *
         frame::RawBytesPerPixel(spec.output);
}

bool MayBand(const frame::FrameSpec& spec, const FrameWish& wish) {
  return wish.may_band && spec.culling != frame::Culling::kMask;
}

// The bytes that a frame takes before its dataset is known, without those of its trace.
absl::StatusOr<std::size_t> BytesToReserve(const CoordinatorMemory& memory,
                                           const frame::FrameSpec& spec, const FrameWish& wish) {
  ISOSCOPE_ASSIGN_OR_RETURN(const BandGrid bands, memory.PlanFrame(spec, wish, {}));
  return bands.count() == 1
             ? FrameBytes(spec, wish.delivery)
             : BandedBytesOf(spec, bands.band(), wish.delivery).most() + kCountingBytes;
}

double Mebibytes(std::size_t bytes) {
  return static_cast<double>(bytes) / static_cast<double>(base::kMiB);
}

}  // namespace

std::size_t CoordinatorMemory::DefaultLimitBytes() {
  return std::max<std::size_t>(base::UsableBytes() / 4, base::kGiB);
}

CoordinatorMemory::CoordinatorMemory(std::size_t limit_bytes, AgentLimit agent_limit)
    : limit_bytes_(limit_bytes),
      agent_limit_(std::move(agent_limit)),
      frames_(agent_limit_ == nullptr ? FrameCapacity(limit_bytes) : BandCapacity(limit_bytes)),
      exports_(std::max(limit_bytes / kExportShare, kExportAnswerBytes + 8 * kExportBytesPerAgent)),
      tiles_(TilesBytesOf(limit_bytes)) {
  ISOSCOPE_CHECK_GE(limit_bytes, kMinLimitBytes);
}

std::size_t CoordinatorMemory::unused_image_bytes() const {
  return std::min(limit_bytes_ / kUnusedImageShare - TilesBytesOf(limit_bytes_),
                  kMaxUnusedImageBytes);
}

std::size_t CoordinatorMemory::tiles_bytes() const { return tiles_.capacity_bytes(); }

std::size_t CoordinatorMemory::active_blocks_bytes() const {
  return std::min(limit_bytes_ / kActiveBlocksShare, kMaxActiveBlocksBytes);
}

std::size_t CoordinatorMemory::trace_bytes() const { return TraceBytesOf(limit_bytes_); }

bool CoordinatorMemory::FitsAtOnce(const frame::FrameSpec& spec, std::size_t limit_bytes,
                                   const FrameWish& wish) const {
  return frame::DrawnWindowOf(spec).fits_a_view() &&
         FrameBytes(spec, wish.delivery) + TraceBytesOf(limit_bytes, wish) <=
             FrameCapacity(limit_bytes);
}

bool CoordinatorMemory::AgentsFit(const frame::FrameSpec& spec, std::size_t limit_bytes) const {
  return agent_limit_ == nullptr || agent_limit_(spec) <= limit_bytes;
}

// A band takes 3/4 of what agents have for pixels: one that is a third higher would fit, too.
// OpenGL takes the same for each band, the whole.
bool CoordinatorMemory::AgentsFitBand(const frame::FrameSpec& spec, const view::Viewport& band,
                                      std::size_t limit_bytes) const {
  const int height =
      std::min(band.height_px + band.height_px / 3, frame::ImageSizeOf(spec).height_px);
  return AgentsFit(BandInTheMiddle(spec, {band.width_px, height}), limit_bytes);
}

std::size_t CoordinatorMemory::BandCapacity(std::size_t limit_bytes) const {
  const std::size_t share = FrameCapacity(limit_bytes);
  return agent_limit_ == nullptr ? share : std::min(share, BytesBesideAgents(limit_bytes));
}

std::size_t CoordinatorMemory::BytesForBands(const frame::FrameSpec& spec, std::size_t limit_bytes,
                                             const FrameWish& wish, const FrameNeeds& needs) const {
  if (FitsAtOnce(spec, limit_bytes, wish) && AgentsFit(spec, limit_bytes)) {
    // An agent elsewhere objects, after ReserveFrame.
    const std::size_t taken = FrameBytes(spec, wish.delivery);
    return taken - std::min(taken, needs.counting_bytes);
  }
  const std::size_t besides =
      TraceBytesOf(limit_bytes, wish) + std::max(needs.counting_bytes, kCountingBytes);
  const std::size_t capacity = BandCapacity(limit_bytes);
  return capacity - std::min(capacity, besides);
}

bool CoordinatorMemory::FitsInBands(const frame::FrameSpec& spec, const view::Viewport& band,
                                    std::size_t limit_bytes, std::size_t bytes, Delivery delivery,
                                    std::size_t max_drawn_pixels) const {
  const frame::FrameSpec of_band = BandInTheMiddle(spec, band);
  if (band == frame::ImageSizeOf(spec) || !frame::DrawnWindowOf(of_band).fits_a_view() ||
      (max_drawn_pixels > 0 && DrawnPixelsOf(of_band) > max_drawn_pixels) ||
      !AgentsFitBand(spec, band, limit_bytes)) {
    return false;
  }
  const BandedBytes needed = BandedBytesOf(spec, band, delivery);
  return needed.kept <= bytes && needed.band <= BandShareOf(bytes - needed.kept) &&
         std::max(needed.encode, needed.send) <= bytes;
}

absl::StatusOr<BandGrid> CoordinatorMemory::PlanFrame(const frame::FrameSpec& spec,
                                                      const FrameWish& wish,
                                                      const FrameNeeds& needs) const {
  const view::Viewport picture = frame::ImageSizeOf(spec);
  // Whether nobody here objects to the whole. Agents elsewhere know their limits.
  const bool fits = FitsAtOnce(spec, limit_bytes_, wish) && needs.max_drawn_pixels == 0;
  if (fits && AgentsFit(spec, limit_bytes_)) {
    return BandGrid(picture, picture);
  }
  if (MayBand(spec, wish)) {
    const std::size_t bytes = BytesForBands(spec, limit_bytes_, wish, needs);
    // What agents of this process have beside these planes and those that a client still holds.
    std::size_t for_agents =
        limit_bytes_ - (agent_limit_ == nullptr ? 0 : std::min(2 * RawBytesOf(spec), limit_bytes_));
    const auto fits_share = [&](const view::Viewport& band) {
      return FitsInBands(spec, band, for_agents, bytes, wish.delivery, needs.max_drawn_pixels);
    };
    std::optional<BandGrid> bands = BestBands(spec, fits_share);
    if (!bands.has_value() && for_agents < limit_bytes_) {
      for_agents = limit_bytes_;
      bands = BestBands(spec, fits_share);
    }
    if (bands.has_value() && needs.counting_bytes > kCountingBytes) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t taken, BytesToReserve(*this, spec, wish));
      const auto fits_taken = [&](const view::Viewport& band) {
        return fits_share(band) &&
               BandedBytesOf(spec, band, wish.delivery).most() + needs.counting_bytes <= taken;
      };
      if (const std::optional<BandGrid> within = BestBands(spec, fits_taken); within.has_value()) {
        bands = within;
      }
    }
    if (bands.has_value()) {
      return *bands;
    }
  }
  if (MayBand(spec, wish) && SmallestBandExceedsAgents(spec)) {
    return TooLargeForAgents(spec, wish, needs);
  }
  if (fits) {  // the agents say what they lack
    return BandGrid(picture, picture);
  }
  return TooLarge(spec, wish, needs);
}

absl::StatusOr<BandGrid> CoordinatorMemory::PlanDrawing(const frame::FrameSpec& drawing,
                                                        const frame::FrameSpec& frame,
                                                        const FrameWish& wish,
                                                        const FrameNeeds& needs) const {
  const view::Viewport picture = frame::ImageSizeOf(frame);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t taken, BytesToReserve(*this, frame, wish));
  if (needs.max_drawn_pixels == 0 && frame::DrawnWindowOf(drawing).fits_a_view() &&
      FrameBytes(drawing, Delivery::kParts) <= taken && AgentsFit(drawing, limit_bytes_)) {
    return BandGrid(picture, picture);
  }
  if (MayBand(frame, wish)) {
    const std::size_t bytes = BytesForBands(frame, limit_bytes_, wish, needs);
    const std::optional<BandGrid> bands = BestBands(drawing, [&](const view::Viewport& band) {
      return FitsInBands(drawing, band, limit_bytes_, bytes, Delivery::kParts,
                         needs.max_drawn_pixels) &&
             BandedBytesOf(drawing, band, Delivery::kParts).most() <= taken;
    });
    if (bands.has_value()) {
      return *bands;
    }
  }
  return PlanFrame(frame, wish, needs);
}

std::size_t CoordinatorMemory::LeastLimitFor(const frame::FrameSpec& spec, const FrameWish& wish,
                                             const FrameNeeds& needs) const {
  const frame::FrameSpec largest = WithAllMargins(spec);
  const view::Viewport smallest = SmallestBand(frame::ImageSizeOf(spec));
  return LeastLimit([&](std::size_t limit_bytes) {
    return (FitsAtOnce(largest, limit_bytes, wish) && AgentsFit(largest, limit_bytes)) ||
           (MayBand(spec, wish) &&
            FitsInBands(largest, smallest, limit_bytes,
                        BytesForBands(largest, limit_bytes, wish, needs), wish.delivery,
                        /*max_drawn_pixels=*/0));
  });
}

absl::Status CoordinatorMemory::TooLarge(const frame::FrameSpec& spec, const FrameWish& wish,
                                         const FrameNeeds& needs) const {
  const view::Viewport size = frame::ImageSizeOf(spec);
  const int samples = spec.effects.samples();
  const bool is_in_bands = MayBand(spec, wish);
  const std::size_t bytes =
      TraceBytesOf(limit_bytes_, wish) +
      (is_in_bands ? BandedBytesOf(spec, SmallestBand(size), wish.delivery).most()
                   : FrameBytes(spec, wish.delivery));
  return absl::ResourceExhaustedError(absl::StrFormat(
      "a picture of %d x %d pixels%s needs %.0f MiB in the coordinator%s; with its memory limit of "
      "%.0f MiB at most %.0f MiB may be used: ask for a smaller viewport or for regions of "
      "it%s%s%s, "
      "or raise %s--memory-limit to %.0fMiB",
      size.width_px, size.height_px, samples > 1 ? absl::StrCat(" of ", samples, " samples") : "",
      Mebibytes(bytes), is_in_bands ? ", also in bands" : "", Mebibytes(limit_bytes_),
      Mebibytes(is_in_bands ? BandCapacity(limit_bytes_) : FrameCapacity(limit_bytes_)),
      samples > 1 ? ", or for fewer samples" : "",
      frame::RawBytesPerPixel(spec.output) > 0 ? ", or for fewer planes" : "",
      wish.has_trace ? ", or for no trace" : "",
      agent_limit_ == nullptr ? "the coordinator's " : "",
      Mebibytes(LeastLimitFor(spec, wish, needs))));
}

bool CoordinatorMemory::SmallestBandExceedsAgents(const frame::FrameSpec& spec) const {
  const view::Viewport smallest = SmallestBand(frame::ImageSizeOf(spec));
  return agent_limit_ != nullptr && !AgentsFitBand(spec, smallest, limit_bytes_) &&
         agent_limit_(BandInTheMiddle(spec, smallest)) < agent_limit_(spec);
}

absl::Status CoordinatorMemory::TooLargeForAgents(const frame::FrameSpec& spec,
                                                  const FrameWish& wish,
                                                  const FrameNeeds& needs) const {
  const view::Viewport size = frame::ImageSizeOf(spec);
  const view::Viewport smallest = SmallestBand(size);
  const BandCosts costs = BandCostsOf(spec);
  return absl::ResourceExhaustedError(absl::StrFormat(
      "a picture of %d x %d pixels does not fit the memory limit of %.0f MiB, also in bands: "
      "one of %d x %d pixels%s is too large: %s%sraise --memory-limit to %.0fMiB",
      size.width_px, size.height_px, Mebibytes(limit_bytes_), smallest.width_px, smallest.height_px,
      costs.text, costs.advice, costs.advice.empty() ? "" : ", or ",
      Mebibytes(LeastLimitFor(spec, wish, needs))));
}

absl::Status CoordinatorMemory::CheckFits(const frame::FrameSpec& spec,
                                          const FrameWish& wish) const {
  return PlanFrame(spec, wish, {}).status();
}

absl::StatusOr<base::MemoryBudget::Reservation> CoordinatorMemory::ReserveFrame(
    const frame::FrameSpec& spec, const FrameWish& wish, const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t bytes, BytesToReserve(*this, spec, wish));
  return frames_.Reserve(
      std::min(bytes + TraceBytesOf(limit_bytes_, wish), frames_.capacity_bytes()), cancellation);
}

std::optional<base::MemoryBudget::Reservation> CoordinatorMemory::TryKeepTiles(std::size_t bytes) {
  if (tiles_.reserved_bytes() + bytes > tiles_.capacity_bytes()) {
    return std::nullopt;
  }
  // Another view may take it in between. Then this one waits a moment for what it gives back.
  constexpr absl::Duration kMoment = absl::Milliseconds(1);
  const base::Cancellation soon(base::MonotonicNow() + kMoment);
  absl::StatusOr<base::MemoryBudget::Reservation> kept = tiles_.Reserve(bytes, soon);
  return kept.ok() ? std::optional(*std::move(kept)) : std::nullopt;
}

absl::StatusOr<base::MemoryBudget::Reservation> CoordinatorMemory::ReserveExport(
    std::size_t agent_count, const base::Cancellation& cancellation) {
  const std::size_t bytes = kExportAnswerBytes + agent_count * kExportBytesPerAgent;
  return exports_.Reserve(std::min(bytes, exports_.capacity_bytes()), cancellation);
}

}  // namespace isoscope::server
