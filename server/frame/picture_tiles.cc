// The tiles of a PictureJob:
//
// 1. RunIf finds the target, and draws nothing. Level, camera and parts are those of all tiles.
// 2. BeginTiles takes the memory for the picture's pixels.
// 3. RunTile draws a tile as the bands of a picture are drawn: the first one finds the ranges of
//    maps. A tile that an agent has no room for is drawn in smaller bands. Its ticket has the memory
//    of its region.
// 4. FinishTiles encodes all pixels, and adds what a frame has besides.
//
// Tiles never lose parts, because views do not allow partial pictures. An error ends them all: the
// blocks of a tile that failed may have been counted.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "core/base/check.h"
#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "server/frame/picture_job.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

// Tiles of about this side, of equal sizes.
BandGrid TileGrid(const view::Viewport& picture, int side_px) {
  const int columns = DivideUp(picture.width_px, side_px);
  const int rows = DivideUp(picture.height_px, side_px);
  return {picture, {DivideUp(picture.width_px, columns), DivideUp(picture.height_px, rows)}};
}

std::size_t KeptBytesOf(const frame::FrameSpec& spec, const FrameTarget& target) {
  const view::Viewport size = frame::ImageSizeOf(spec);
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px) *
             frame::kRgba8Bytes +
         DrawnBlocks::BytesOf(target.layout.block_count());
}

}  // namespace

bool PictureJob::BeginTiles(int side_px) {
  ISOSCOPE_CHECK(put_off_.has_value());
  const BandGrid grid = TileGrid(frame::ImageSizeOf(asked_.spec), side_px);
  if (grid.count() == 1) {
    return false;
  }
  std::optional<base::MemoryBudget::Reservation> memory =
      runner_.state().memory.TryKeepTiles(KeptBytesOf(asked_.spec, *put_off_));
  if (!memory.has_value()) {
    return false;
  }
  tiles_ = std::unique_ptr<Tiles>(new Tiles{.target = *put_off_,
                                            .grid = grid,
                                            .memory = *std::move(memory),
                                            .drawn = DrawnBlocks(put_off_->layout.block_count())});
  return true;
}

const BandGrid* PictureJob::tile_grid() const {
  return tiles_ == nullptr ? nullptr : &tiles_->grid;
}

frame::FrameSpec PictureJob::SpecOfTile(int tile) const {
  return SpecOfBand(asked_.spec, tiles_->grid.At(tile));
}

absl::Status PictureJob::RunTile(std::shared_ptr<FrameTicket> ticket, int tile, v1::Tile* proto) {
  ticket_ = std::move(ticket);
  const frame::FrameSpec spec = SpecOfTile(tile);
  const view::Region region = tiles_->grid.At(tile);
  return RunWork(spec, [&]() -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(ticket_->TakeMemory(spec));
    ticket_->NoteDataset(tiles_->target.dataset->dataset);
    ISOSCOPE_RETURN_IF_ERROR(PrepareTiles());
    ISOSCOPE_RETURN_IF_ERROR(RenderTile(spec, region));
    ISOSCOPE_ASSIGN_OR_RETURN(*proto->mutable_png(), base::RunIn(runner_.state().arena.get(), [&] {
      return tiles_->joiner->EncodePart(region);
    }));
    ticket_->CountAnswer(proto->png().size());
    *proto->mutable_region() = wire::ToProto(region);
    proto->set_count(tiles_->grid.count());
    *proto->mutable_extent() = wire::ToProto(frame::ImageSizeOf(asked_.spec));
    *proto->mutable_camera() = wire::ToProto(*asked_.spec.camera);
    *proto->mutable_drawn_level() = ToProto(facts_);
    return absl::OkStatus();
  });
}

// Once, under the ticket of the first tile.
absl::Status PictureJob::PrepareTiles() {
  if (tiles_->joiner.has_value()) {
    return absl::OkStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(FindRanges(tiles_->target));
  FrameOutput none;
  StartAgain(&none);
  band_ = tiles_->grid.band();
  tiles_->joiner.emplace(asked_.spec, /*is_encoded_by_rows=*/false);
  return absl::OkStatus();
}

absl::Status PictureJob::RenderTile(const frame::FrameSpec& spec, const view::Region& tile) {
  const BandsOfPicture picture{
      .target = tiles_->target, .drawn = &tiles_->drawn, .joiner = &*tiles_->joiner};
  FrameNeeds needs;
  const Drawing drawing{.spec = spec};
  ISOSCOPE_ASSIGN_OR_RETURN(BandGrid bands, FirstPlan(drawing, tiles_->target, &needs));
  for (bool was_refused = false;; was_refused = true) {
    absl::Status status;
    for (int i = 0; i < bands.count() && status.ok(); ++i) {
      view::Region band = bands.At(i);
      band.x += tile.x;
      band.y += tile.y;
      status = RenderBandOf(
          picture, band, /*is_last=*/i + 1 == bands.count(), [] {}, &tiles_->cost);
    }
    if (status.ok()) {
      if (was_refused) {
        NoteRoom(tiles_->target, needs);
      }
      return status;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(bands, SmallerPlan(drawing, tiles_->target, bands, status, &needs));
  }
}

absl::Status PictureJob::FinishTiles(std::shared_ptr<FrameTicket> ticket, Response* response) {
  ticket_ = std::move(ticket);
  return RunWork(asked_.spec, [&]() -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(ticket_->TakeMemory(asked_.spec));
    ticket_->NoteDataset(tiles_->target.dataset->dataset);
    const base::MonotonicTime encode_start = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(FrameOutput output, base::RunIn(runner_.state().arena.get(), [&] {
                                return tiles_->joiner->Finish();
                              }));
    cost_ = *std::exchange(tiles_->cost, std::nullopt);
    tiles_->drawn.SetCounts(parts_, &cost_);
    cost_.band_count = tiles_->grid.count();
    cost_.png_bytes = static_cast<std::int64_t>(output.image.size());
    cost_.encode =
        cost_.encode.value_or(absl::ZeroDuration()) + base::MonotonicNow() - encode_start;
    if (depth_grid_builder_.has_value()) {
      depth_grid_ = depth_grid_builder_->Make();
    }
    return Complete(tiles_->target, std::move(output), response);
  });
}

absl::StatusOr<FrameFacts> PictureJob::FindFacts(const FrameTarget& target) {
  NoteDrawn(target);
  FrameFacts facts = facts_;
  ISOSCOPE_ASSIGN_OR_RETURN(facts.active_bytes,
                            runner_.FindActiveBytes(Identity(), asked_.spec, target));
  const frame::FrameSpec& spec = asked_.spec;
  facts.may_tile =
      spec.culling != frame::Culling::kMask &&
      frame::DrawnBy(spec, target.dataset->picture_revision.back_end) == frame::BackEnd::kCpu &&
      spec.output.image_format == frame::ImageFormat::kPng;
  return facts;
}

}  // namespace isoscope::server
