// The limit is divided into shares:
//
//   9/16   frames, with their traces
//   1/8    exports; at least 24 MiB
//   1/8    images between frames; at most 384 MiB
//   1/16   active blocks between frames; at most 64 MiB
//   1/8    the process and gRPC
//
// FrameBytes adds up the peak of one frame. 1024 x 1024 pixels as a PNG in one message take 26 MiB
// drawn (26 bytes a pixel), 4 MiB encoded, 4 MiB of gRPC's copy and 1 MiB besides: 35 MiB. Each of
// max_layers + 1 layers would add 20 MiB.

#include "server/admission/coordinator_memory.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/memory_info.h"
#include "core/base/units.h"
#include "core/frame/drawn_window.h"

namespace isoscope::server {
namespace {

// Bytes for a pixel, or for a translucent fragment of one: bands that have arrived and wait to be
// composited.
constexpr std::size_t kBandBytesPerPixel = 8;
// Bytes for a pixel: 12 for the image (key and colour), 6 for the occlusion map, and its bands.
constexpr std::size_t kFrameBytesPerPixel = 12 + 6 + kBandBytesPerPixel;
// Bytes for a translucent fragment of a pixel: 12 for key and colour, and its bands.
constexpr std::size_t kLayerBytesPerPixel = 12 + kBandBytesPerPixel;
// A picture that differs from the drawn pixels has an image of its own (key and colour). It is
// allocated after occlusion map and bands are freed; its effects reuse their bytes.
constexpr std::size_t kPictureImageBytesPerPixel = 12;
// An encoded picture of noise is as large as its pixels, and a little more.
constexpr std::size_t kPictureBytesPerPixel = frame::kRgba8Bytes;
// Every frame needs this much besides: messages, lists of blocks.
constexpr std::size_t kLeastFrameBytes = base::kMiB;
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
constexpr std::size_t kTraceShare = 8;  // of one frame, out of the frames' share
constexpr std::size_t kMaxTraceBytes = 32 * base::kMiB;

std::size_t PixelsOf(const view::Viewport& size) {
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
}

// The share of frames.
std::size_t FrameCapacity(std::size_t limit_bytes) { return limit_bytes / kFrameShare * 9; }

std::size_t TraceBytesOf(std::size_t limit_bytes) {
  return std::min(limit_bytes / kTraceShare, kMaxTraceBytes);
}

// The least limit, in whole MiB, with room for a frame that takes `bytes` without its trace.
std::size_t LeastLimitFor(std::size_t bytes, bool has_trace) {
  std::size_t too_small = 0;
  std::size_t enough = std::size_t{1} << 30;  // a PiB
  while (enough - too_small > 1) {
    const std::size_t middle = too_small + (enough - too_small) / 2;
    const std::size_t limit = middle * base::kMiB;
    const bool fits = bytes + (has_trace ? TraceBytesOf(limit) : 0) <= FrameCapacity(limit);
    (fits ? enough : too_small) = middle;
  }
  return enough * base::kMiB;
}

// The frame with its region in the middle, where it has margins on all sides. A large picture is
// asked for region by region, and the first one lies in a corner.
frame::FrameSpec WithAllMargins(frame::FrameSpec spec) {
  if (spec.region.has_value()) {
    spec.region->x = (spec.viewport.width_px - spec.region->width_px) / 2;
    spec.region->y = (spec.viewport.height_px - spec.region->height_px) / 2;
  }
  return spec;
}

double Mebibytes(std::size_t bytes) {
  return static_cast<double>(bytes) / static_cast<double>(base::kMiB);
}

}  // namespace

std::size_t FrameBytes(const frame::FrameSpec& spec, Delivery delivery) {
  const frame::DrawnWindow window = frame::DrawnWindowOf(spec);
  const std::size_t pixels = PixelsOf(frame::ImageSizeOf(spec));
  const std::size_t layers =
      frame::HasLayers(spec) ? static_cast<std::size_t>(spec.max_layers + 1) * kLayerBytesPerPixel
                             : 0;
  const std::size_t drawn = PixelsOf(window.image_size()) * (kFrameBytesPerPixel + layers) +
                            (window.is_picture_of(spec) ? 0 : pixels * kPictureImageBytesPerPixel);
  const frame::OutputSpec& output = spec.output;
  const bool is_compressed = output.image_format == frame::ImageFormat::kPng ||
                             output.image_format == frame::ImageFormat::kJpeg;
  const std::size_t response =
      frame::RawBytesPerPixel(output) + (is_compressed ? kPictureBytesPerPixel : 0);
  // Stripes are joined into a compressed picture, and gRPC copies a whole response. The two never
  // happen at the same time.
  const std::size_t copies = delivery == Delivery::kWhole ? response
                             : is_compressed              ? kPictureBytesPerPixel
                                                          : 0;
  return drawn + pixels * (response + copies) + kLeastFrameBytes;
}

std::size_t WaitingBandBytes(const frame::FrameSpec& spec) {
  const std::size_t layers =
      frame::HasLayers(spec) ? static_cast<std::size_t>(spec.max_layers + 1) : 0;
  return std::max(
      PixelsOf(frame::DrawnWindowOf(spec).image_size()) * (1 + layers) * kBandBytesPerPixel,
      kLeastFrameBytes);
}

std::size_t CoordinatorMemory::DefaultLimitBytes() {
  return std::max<std::size_t>(base::UsableBytes() / 4, base::kGiB);
}

CoordinatorMemory::CoordinatorMemory(std::size_t limit_bytes, AgentLimit agent_limit)
    : limit_bytes_(limit_bytes),
      agent_limit_(std::move(agent_limit)),
      frames_(FrameCapacity(limit_bytes)),
      exports_(
          std::max(limit_bytes / kExportShare, kExportAnswerBytes + 8 * kExportBytesPerAgent)) {
  ISOSCOPE_CHECK_GE(limit_bytes, kMinLimitBytes);
}

std::size_t CoordinatorMemory::unused_image_bytes() const {
  return std::min(limit_bytes_ / kUnusedImageShare, kMaxUnusedImageBytes);
}

std::size_t CoordinatorMemory::active_blocks_bytes() const {
  return std::min(limit_bytes_ / kActiveBlocksShare, kMaxActiveBlocksBytes);
}

std::size_t CoordinatorMemory::trace_bytes() const { return TraceBytesOf(limit_bytes_); }

absl::Status CoordinatorMemory::CheckFits(const frame::FrameSpec& spec, Delivery delivery,
                                          std::size_t trace_bytes) const {
  const std::size_t bytes = FrameBytes(spec, delivery) + trace_bytes;
  if (bytes <= frames_.capacity_bytes()) {
    return absl::OkStatus();
  }
  const view::Viewport size = frame::ImageSizeOf(spec);
  const int samples = spec.effects.samples();
  const frame::FrameSpec largest = WithAllMargins(spec);
  std::size_t enough = LeastLimitFor(FrameBytes(largest, delivery), trace_bytes > 0);
  if (agent_limit_ != nullptr) {
    enough = std::max(enough, agent_limit_(largest));
  }
  return absl::ResourceExhaustedError(absl::StrFormat(
      "a picture of %d x %d pixels%s needs %.0f MiB in the coordinator; with its memory limit of "
      "%.0f MiB at most %.0f MiB may be used: ask for a smaller viewport or for regions of "
      "it%s%s%s, "
      "or raise %s--memory-limit to %.0fMiB",
      size.width_px, size.height_px, samples > 1 ? absl::StrCat(" of ", samples, " samples") : "",
      Mebibytes(bytes), Mebibytes(limit_bytes_), Mebibytes(frames_.capacity_bytes()),
      samples > 1 ? ", or for fewer samples" : "",
      frame::RawBytesPerPixel(spec.output) > 0 ? ", or for fewer planes" : "",
      trace_bytes > 0 ? ", or for no trace" : "",
      agent_limit_ == nullptr ? "the coordinator's " : "", Mebibytes(enough)));
}

absl::StatusOr<base::MemoryBudget::Reservation> CoordinatorMemory::ReserveFrame(
    const frame::FrameSpec& spec, Delivery delivery, const base::Cancellation& cancellation,
    std::size_t trace_bytes) {
  if (absl::Status status = CheckFits(spec, delivery, trace_bytes); !status.ok()) {
    return status;
  }
  return frames_.Reserve(FrameBytes(spec, delivery) + trace_bytes, cancellation);
}

absl::StatusOr<base::MemoryBudget::Reservation> CoordinatorMemory::ReserveExport(
    std::size_t agent_count, const base::Cancellation& cancellation) {
  const std::size_t bytes = kExportAnswerBytes + agent_count * kExportBytesPerAgent;
  return exports_.Reserve(std::min(bytes, exports_.capacity_bytes()), cancellation);
}

}  // namespace isoscope::server
