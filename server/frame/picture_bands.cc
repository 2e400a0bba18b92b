// The bands of a PictureJob:
//
// 1. RenderOutput asks for the plan, which the memory of the coordinator decides. It knows agents
//    of its own process. Agents elsewhere say that a band is too large; then all begins again with
//    bands of half the pixels. These are at most some twenty tries, of which all but the last draw
//    little. If the last one is drawn, AgentRoom keeps its size for the next frames: a refusal of
//    any size has another cause. Agents that lack files, or memory beyond their limit, are busy: no
//    size helps (MayWorkSmaller). Ranges of what is visible have bands of their own: their drawings
//    have one sample, no margin and no answer.
// 2. RenderAllBands draws one band after another, each as a region of the picture.
// 3. RenderBands begins again, with the parts that are left, if a part is lost in between
//    (allow_partial).

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "server/frame/color_ranges.h"
#include "server/frame/picture_job.h"
#include "server/frame/render_statistics.h"
#include "wire/color_range_convert.h"

namespace isoscope::server {
namespace {

std::size_t DrawnPixelsOf(const frame::FrameSpec& spec) {
  const view::Viewport drawn = frame::DrawnWindowOf(spec).image_size();
  return static_cast<std::size_t>(drawn.width_px) * static_cast<std::size_t>(drawn.height_px);
}

int DrawnLayersOf(const frame::FrameSpec& spec) {
  return frame::HasLayers(spec) ? spec.max_layers : 0;
}

bool DrawnByOpenGl(const FrameTarget& target, const frame::FrameSpec& spec) {
  return frame::DrawnBy(spec, target.dataset->picture_revision.back_end) == frame::BackEnd::kEgl;
}

// The most bands that a trace has details of, and the least spans of an agent for each of their
// drawings. A picture may have thousands, and some memory is taken by each, however few spans it
// has.
constexpr int kMaxDetailedBands = 64;
constexpr std::size_t kMinSpansOfDrawing = 64;

// An error for which bands of fewer pixels are no help.
absl::Status NamedForOpenGl(const absl::Status& error) {
  return {error.code(),
          absl::StrCat(error.message(),
                       "; the agents draw with OpenGL, which takes the whole picture also for a "
                       "band of it: start them with --renderer cpu")};
}

// Smaller bands are no help, and neither is a smaller picture, which the agent can't know.
absl::Status NamedForSmallestBand(const absl::Status& error, const frame::FrameSpec& spec,
                                  const BandGrid& bands) {
  const BandCosts costs = BandCostsOf(spec);
  if (costs.advice.empty()) {
    return error;
  }
  const std::string band = bands.count() == 1
                               ? "bands of it are no help"
                               : absl::StrCat("that was the smallest band, ", bands.band().width_px,
                                              " x ", bands.band().height_px, " pixels");
  return {error.code(), absl::StrCat(error.message(), "; ", band, costs.text, ": ", costs.advice)};
}

}  // namespace

// Draws at once, or in bands; in smaller ones if an agent has no room for these.
absl::Status PictureJob::RenderOutput(const FrameTarget& target, absl::FunctionRef<void()> on_drawn,
                                      FrameOutput* output) {
  FrameNeeds needs{.counting_bytes = DrawnBlocks::BytesOf(target.layout.block_count())};
  const Drawing picture{.spec = asked_.spec};
  ISOSCOPE_ASSIGN_OR_RETURN(BandGrid bands, FirstPlan(picture, target, &needs));
  for (bool was_refused = false;; was_refused = true) {
    StartAgain(output);
    absl::Status status = bands.count() == 1 ? RenderAtOnce(target, on_drawn, output)
                                             : RenderBands(target, bands, on_drawn, output);
    if (status.ok() && depth_grid_builder_.has_value()) {
      depth_grid_ = depth_grid_builder_->Make();
    }
    if (status.ok()) {
      if (was_refused) {
        NoteRoom(target, needs);
      }
      return status;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(bands, SmallerPlan(picture, target, bands, status, &needs));
  }
}

absl::StatusOr<BandGrid> PictureJob::Plan(const Drawing& drawing, const FrameNeeds& needs) const {
  return drawing.is_of_values ? ticket_->PlanDrawing(drawing.spec, asked_.spec, needs)
                              : ticket_->PlanFrame(drawing.spec, needs);
}

// Ranges of what is visible draw the picture, too.
absl::Status PictureJob::FindRanges(const FrameTarget& target) {
  const base::TraceScope trace(recorder(), "colour ranges");
  const FrameIdentity identity = Identity();
  FrameToRange frame{.runner = &runner_,
                     .identity = &identity,
                     .target = &target,
                     .parts = &parts_,
                     .is_drawn_after = asked_.spec.output.is_drawn(),
                     .following = &following_};
  if (!wire::HasVisibleRanges(asked_.spec)) {
    return ResolveRanges(frame, &asked_);
  }
  const frame::FrameSpec spec_of_values = SpecOfValues(asked_.spec);
  const Drawing of_values{.spec = spec_of_values, .is_of_values = true};
  FrameNeeds needs;
  ISOSCOPE_ASSIGN_OR_RETURN(BandGrid bands, FirstPlan(of_values, target, &needs));
  for (bool was_refused = false;; was_refused = true) {
    frame.bands.clear();
    for (int i = 0; bands.count() > 1 && i < bands.count(); ++i) {
      frame.bands.push_back(bands.At(i));
    }
    AskedFrame resolved = asked_;
    absl::Status status = ResolveRanges(frame, &resolved);
    if (status.ok()) {
      if (was_refused) {
        NoteRoom(target, needs);
      }
      asked_ = std::move(resolved);
      return status;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(bands, SmallerPlan(of_values, target, bands, status, &needs));
  }
}

void PictureJob::NoteRoom(const FrameTarget& target, const FrameNeeds& needs) {
  runner_.agent_room().Note(target.dataset->dataset.dataset_id(), DrawnLayersOf(asked_.spec),
                            needs.max_drawn_pixels);
}

absl::StatusOr<BandGrid> PictureJob::SmallerPlan(const Drawing& drawing, const FrameTarget& target,
                                                 const BandGrid& bands, const absl::Status& error,
                                                 FrameNeeds* needs) {
  if (!MayWorkSmaller(error)) {
    return error;
  }
  // Half of what was refused; at last the least that a band draws, which margins may make more.
  const view::Viewport smallest = SmallestBand(frame::ImageSizeOf(drawing.spec));
  const std::size_t refused = DrawnPixelsOf(BandInTheMiddle(drawing.spec, bands.band()));
  const std::size_t least = DrawnPixelsOf(BandInTheMiddle(drawing.spec, smallest));
  if (least >= refused) {
    return NamedForSmallestBand(error, drawing.spec, bands);
  }
  needs->max_drawn_pixels = std::max(refused / 2, least);
  absl::StatusOr<BandGrid> smaller = Plan(drawing, *needs);
  if (!smaller.ok()) {
    return NamedForSmallestBand(error, drawing.spec, bands);
  }
  if (DrawnByOpenGl(target, drawing.spec)) {
    return NamedForOpenGl(error);
  }
  base::LogInfo("frame_in_smaller_bands", {{"request", ticket_->request().request_id()},
                                           {"bands", smaller->count()},
                                           {"status", error}});
  return smaller;
}

// Begins with bands that agents had room for, if they refused larger ones lately.
absl::StatusOr<BandGrid> PictureJob::FirstPlan(const Drawing& drawing, const FrameTarget& target,
                                               FrameNeeds* needs) {
  const std::size_t room = runner_.agent_room().MostPixels(target.dataset->dataset.dataset_id(),
                                                           DrawnLayersOf(drawing.spec));
  if (room > 0 && DrawnPixelsOf(drawing.spec) > room) {
    FrameNeeds within = *needs;
    within.max_drawn_pixels = room;
    const absl::StatusOr<BandGrid> bands = Plan(drawing, within);
    if (bands.ok()) {
      *needs = within;
      return *bands;
    }
  }
  return Plan(drawing, *needs);
}

absl::Status PictureJob::RenderBands(const FrameTarget& target, const BandGrid& bands,
                                     absl::FunctionRef<void()> on_drawn, FrameOutput* output) {
  for (;;) {
    const std::size_t part_count = parts_.size();
    BandJoiner joiner(asked_.spec, IsEncodedByRows(asked_.spec));
    ISOSCOPE_RETURN_IF_ERROR(RenderAllBands(target, bands, on_drawn, &joiner));
    if (parts_.size() < part_count) {
      StartAgain(output);  // some bands have shards that others lack
      continue;
    }
    base::ReturnFreedMemory();  // of the bands, before gRPC copies the answer
    const base::MonotonicTime encode_start = base::MonotonicNow();
    const base::TraceScope trace(recorder(), "join bands");
    ISOSCOPE_ASSIGN_OR_RETURN(
        *output, base::RunIn(runner_.state().arena.get(), [&] { return joiner.Finish(); }));
    if (asked_.spec.output.image_format == frame::ImageFormat::kPng) {
      cost_.png_bytes = static_cast<std::int64_t>(output->image.size());
    }
    cost_.encode =
        cost_.encode.value_or(absl::ZeroDuration()) + base::MonotonicNow() - encode_start;
    return absl::OkStatus();
  }
}

int PictureJob::DetailedBandCount(int band_count) const {
  if (trace_ == nullptr) {
    return 0;
  }
  // As FrameRunner::Run shares the spans: three quarters are for the agents.
  const std::size_t spans_of_part =
      runner_.state().memory.max_trace_spans() / 4 * 3 / parts_.size();
  const std::size_t fitting = std::clamp<std::size_t>(spans_of_part / (2 * kMinSpansOfDrawing), 1,
                                                      std::size_t{kMaxDetailedBands});
  return std::min(band_count, static_cast<int>(fitting));
}

// Returns early if parts are lost.
absl::Status PictureJob::RenderAllBands(const FrameTarget& target, const BandGrid& bands,
                                        absl::FunctionRef<void()> on_drawn, BandJoiner* joiner) {
  const std::size_t part_count = parts_.size();
  band_ = bands.band();
  DrawnBlocks drawn(target.layout.block_count());
  std::optional<FrameCost> cost;
  const int detailed_count = DetailedBandCount(bands.count());
  const BandsOfPicture picture{.target = target,
                               .drawn = &drawn,
                               .joiner = joiner,
                               .drawing_count = 2 * std::max(detailed_count, 1)};
  for (int i = 0; i < bands.count(); ++i) {
    has_details_ = i < detailed_count;
    const base::TraceScope trace(trace_ == nullptr || has_details_ ? nullptr : &trace_->recorder,
                                 "band");
    const bool is_last = i + 1 == bands.count();
    ISOSCOPE_RETURN_IF_ERROR(RenderBandOf(
        picture, bands.At(i), is_last,
        [&] {
          if (is_last) {
            on_drawn();
          }
        },
        &cost));
    if (parts_.size() < part_count) {
      return absl::OkStatus();
    }
  }
  has_details_ = true;
  cost_ = *std::move(cost);
  drawn.SetCounts(parts_, &cost_);
  cost_.band_count = bands.count();
  return absl::OkStatus();
}

absl::Status PictureJob::RenderBandOf(const BandsOfPicture& picture, const view::Region& band,
                                      bool is_last, absl::FunctionRef<void()> on_drawn,
                                      std::optional<FrameCost>* cost) {
  const std::size_t part_count = parts_.size();
  const frame::FrameSpec spec = SpecOfBand(asked_.spec, band);
  FrameTarget of_band = picture.target;
  ISOSCOPE_ASSIGN_OR_RETURN(of_band.view, picture.target.ViewOf(spec));
  const Piece piece{.spec = spec,
                    .target = of_band,
                    .band = band,
                    .context = {.drawn = picture.drawn,
                                .drawing_count = picture.drawing_count,
                                .others_follow = !is_last},
                    .drawn = picture.drawn,
                    .joiner = picture.joiner};
  ISOSCOPE_RETURN_IF_ERROR(RenderBand(piece, on_drawn));
  if (parts_.size() < part_count) {
    return absl::OkStatus();  // a part was lost, and all bands begin again
  }
  if (!cost->has_value()) {
    *cost = std::move(cost_);
  } else {
    // Without culling agents draw, and count, all their blocks for each band.
    AddBand(cost_, /*has_surface=*/asked_.spec.culling != frame::Culling::kNone, &**cost);
  }
  return absl::OkStatus();
}

}  // namespace isoscope::server
