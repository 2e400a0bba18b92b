// 1. Ranges that follow from the description of the dataset: wire::ResolveColorRanges. SelectVolume
//    has set those of surfaces that show a field.
// 2. Percentiles of caps: from the histogram of the volume, summed over all shards. A partial picture
//    has the range of the step if an agent is lost meanwhile.
// 3. What is visible: the frame is drawn with normals and steps in place of colours, at one sample a
//    pixel. A step bounds a value to 1/256 of the map's range. Where the steps that show are few,
//    their span becomes the range, and the frame is drawn again.
//
// Each starts from the range over all steps, so that every agent, block and order gives the same. If
// a part is lost between two drawings of 3, they begin again: a range has no values of lost parts.

#include "server/frame/color_ranges.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <utility>

#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/picture/color_map.h"
#include "core/picture/sample_window.h"
#include "core/picture/visible_values.h"
#include "server/cluster/replica_board.h"
#include "server/frame/agent_call.h"
#include "server/frame/agent_queries.h"
#include "server/frame/sample_counts.h"
#include "wire/color_range_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

using frame::RangeSource;

// A range can shrink by up to 256 with each drawing.
constexpr int kMaxValueDrawings = 4;

absl::StatusOr<std::shared_ptr<const SampleCounts>> FindSampleCounts(const FrameToRange& frame) {
  const isoscope::v1::Dataset& dataset = frame.target->dataset->dataset;
  SampleCountsCache& cache = frame.runner->sample_counts();
  if (std::shared_ptr<const SampleCounts> known = cache.Find(dataset.dataset_id());
      known != nullptr) {
    return known;
  }
  QueryOutcome<volume::HistogramPart> outcome =
      AskHistogram({dataset.dataset_id(), *frame.parts, frame.runner->state().NextTurn()},
                   {.max_bin_count = 1, .value_range = std::nullopt}, *frame.identity->request,
                   *frame.identity->cancellation);
  frame.runner->state().ReportQuery(*frame.identity->request, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  auto counts = std::make_shared<const SampleCounts>(SampleCounts{
      .samples = std::move(outcome.result->samples), .value_range = outcome.result->value_range});
  if (MissingShards(dataset.shard_count(), *frame.parts).empty()) {
    cache.Insert(dataset.dataset_id(), counts);
  }
  return std::shared_ptr<const SampleCounts>(std::move(counts));
}

// The range between the percentiles of caps; none if there are no counts, or if both are one value.
absl::StatusOr<std::optional<frame::ColorRange>> RangeOfPercentiles(const FrameToRange& frame,
                                                                    const AskedFrame& asked) {
  const frame::FrameSpec& spec = asked.spec;
  const absl::StatusOr<std::shared_ptr<const SampleCounts>> found = FindSampleCounts(frame);
  std::optional<frame::ColorRange> range;
  if (asked.allow_partial && LacksParts(found.status())) {
    return range;
  }
  ISOSCOPE_RETURN_IF_ERROR(found.status());
  const std::shared_ptr<const SampleCounts>& counts = *found;
  if (!counts->samples.has_value()) {
    return range;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::ScalarType type,
      wire::ScalarTypeFromProto(frame.target->dataset->dataset.sample_type(), "sample_type"));
  const std::optional<volume::ScalarSpan> span = picture::SpanOfPercentiles(
      type, *counts->samples, *spec.caps->percentiles, picture::LeastSampleOf(spec));
  if (span.has_value()) {
    // The first and the last bin may be longer than the samples.
    const double min = std::max(span->min, counts->value_range.min);
    const double max = std::min(span->max, counts->value_range.max);
    if (min < max) {
      range = frame::ColorRangeOfSamples(min, max);
    }
  }
  return range;
}

absl::Status ResolvePercentiles(const FrameToRange& frame, AskedFrame* asked) {
  frame::FrameSpec* const spec = &asked->spec;
  if (!frame::HasSampleCaps(*spec) || !spec->caps->percentiles.has_value() ||
      spec->caps->range.has_value()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(spec->caps->range, RangeOfPercentiles(frame, *asked));
  if (!spec->caps->range.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->caps->range,
                              wire::ColorRangeOf(frame.target->selected.at_step, "caps.range"));
  }
  return absl::OkStatus();
}

// Takes what a drawing shows as the range of a map that asked for it. No value shows: it keeps the
// range of all steps.
void Narrow(const std::optional<picture::VisibleSpan>& visible, bool is_last,
            std::optional<frame::ColorRange>* range, RangeSource* source) {
  if (*source != RangeSource::kVisible) {
    return;
  }
  if (visible.has_value()) {
    *range = visible->range;
  }
  if (is_last || !visible.has_value() || visible->is_fine) {
    *source = RangeSource::kAllSteps;
  }
}

// Agents get numbers: those of positions are known without samples.
void ResolvePositions(const volume::GridGeometry& geometry, frame::FrameSpec* spec) {
  for (frame::Surface& surface : spec->surfaces) {
    if (surface.color_by.has_value() && !surface.shows_values() &&
        surface.color_by->quantity != frame::ColorBy::Quantity::kNormal) {
      surface.color_by->range = picture::ColorRangeOf(*surface.color_by, geometry);
    }
  }
}

// Draws the frame, or a region of it.
absl::Status DrawValues(const FrameToRange& frame, AskedFrame stepped,
                        const std::optional<view::Region>& region,
                        picture::VisibleValues* visible) {
  stepped.spec.region = region;
  FrameTarget target = *frame.target;
  ISOSCOPE_ASSIGN_OR_RETURN(target.view, target.ViewOf(stepped.spec));
  FrameIdentity identity = *frame.identity;
  identity.trace = nullptr;
  identity.agent_traces = nullptr;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const FrameResult result,
      frame.runner->Run(identity, stepped, target, frame.parts,
                        {.others_follow = frame.is_drawn_after, .following = frame.following}));
  ISOSCOPE_RETURN_IF_ERROR(identity.cancellation->Check());
  base::RunIn(frame.runner->state().arena.get(), [&] {
    visible->Add({.order = target.order,
                  .image = &result.image,
                  .layers = &result.layers,
                  .view = &target.view});
  });
  return absl::OkStatus();
}

// Draws the frame with steps, all its bands. Returns early if parts are lost.
absl::Status DrawAllValues(const FrameToRange& frame, const AskedFrame& asked,
                           picture::VisibleValues* visible) {
  if (frame.bands.empty()) {
    return DrawValues(frame, asked, std::nullopt, visible);
  }
  const std::size_t part_count = frame.parts->size();
  for (const view::Region& band : frame.bands) {
    ISOSCOPE_RETURN_IF_ERROR(DrawValues(frame, asked, band, visible));
    if (frame.parts->size() < part_count) {
      break;
    }
  }
  return absl::OkStatus();
}

// Narrows the ranges until they are fine. Returns early if parts are lost.
absl::Status NarrowToVisible(const FrameToRange& frame, AskedFrame* asked) {
  frame::FrameSpec& spec = asked->spec;
  const std::size_t part_count = frame.parts->size();
  for (int drawing = 1; wire::HasVisibleRanges(spec); ++drawing) {
    AskedFrame stepped = *asked;
    stepped.spec = SpecOfValues(spec);
    picture::VisibleValues visible(stepped.spec);
    ISOSCOPE_RETURN_IF_ERROR(DrawAllValues(frame, stepped, &visible));
    if (frame.parts->size() < part_count) {
      return absl::OkStatus();
    }
    const bool is_last = drawing == kMaxValueDrawings;
    for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
      if (std::optional<frame::ColorBy>& color_by = spec.surfaces[i].color_by;
          color_by.has_value()) {
        Narrow(visible.OfSurface(i), is_last, &color_by->range, &color_by->range_source);
      }
    }
    if (frame::HasSampleCaps(spec)) {
      Narrow(visible.OfCaps(), is_last, &spec.caps->range, &spec.caps->range_source);
    }
  }
  return absl::OkStatus();
}

absl::Status ResolveVisible(const FrameToRange& frame, AskedFrame* asked) {
  for (;;) {
    const std::size_t part_count = frame.parts->size();
    AskedFrame narrowed = *asked;
    ISOSCOPE_RETURN_IF_ERROR(NarrowToVisible(frame, &narrowed));
    if (frame.parts->size() == part_count) {
      *asked = std::move(narrowed);
      return absl::OkStatus();
    }
  }
}

}  // namespace

frame::FrameSpec SpecOfValues(const frame::FrameSpec& spec) {
  frame::FrameSpec of_values = spec;
  of_values.effects = {};
  of_values.output = {.image_format = frame::ImageFormat::kNone};
  of_values.sends_normals = true;
  of_values.sends_map_steps = frame::ShowsValues(spec);
  if (frame::HasSampleCaps(spec)) {
    of_values.caps->map = frame::ColorMap::kGrey;  // its colours are the steps
  }
  return of_values;
}

absl::Status ResolveRanges(const FrameToRange& frame, AskedFrame* asked) {
  ISOSCOPE_RETURN_IF_ERROR(wire::ResolveColorRanges(frame.target->dataset->dataset,
                                                    frame.target->selected.at_step, &asked->spec));
  ResolvePositions(frame.target->whole, &asked->spec);
  ISOSCOPE_RETURN_IF_ERROR(ResolvePercentiles(frame, asked));
  return ResolveVisible(frame, asked);
}

}  // namespace isoscope::server
