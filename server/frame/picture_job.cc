#include "server/frame/picture_job.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/picture/deferred_shading.h"
#include "core/picture/layer_blending.h"
#include "core/view/level_choice.h"
#include "server/frame/agent_queries.h"
#include "server/frame/render_statistics.h"
#include "server/frame/surface_notes.h"
#include "server/picture/picture_finish.h"
#include "wire/color_range_convert.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"
#include "wire/trace_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// An encoding of a picture: its name in a trace, and its field.
struct Encoding {
  const char* name = "no picture";
  std::string* (v1::RenderIsosurfaceResponse::*field)() = nullptr;
};

Encoding EncodingOf(frame::ImageFormat format) {
  switch (format) {
    case frame::ImageFormat::kPng:
      return {"png", &v1::RenderIsosurfaceResponse::mutable_png};
    case frame::ImageFormat::kJpeg:
      return {"jpeg", &v1::RenderIsosurfaceResponse::mutable_jpeg};
    case frame::ImageFormat::kRgba8:
      return {"raw picture", &v1::RenderIsosurfaceResponse::mutable_rgba8};
    case frame::ImageFormat::kNone:
      break;
  }
  return {};
}

// Returns true if planes were asked for that `output` does not have yet.
bool NeedsPlanes(const frame::OutputSpec& wanted, const FrameOutput& output) {
  return (wanted.depth && output.depth.empty()) ||
         (wanted.surface_index && output.surface_index.empty()) ||
         (wanted.position && output.position.empty()) || (wanted.normal && output.normal.empty());
}

// Returns true if a picture of this spec is shaded from an image that carries the plane of normals.
// Caps with samples and layers have no normals, and steps of a colour map are sent in their place.
bool CarriesNormalPlane(const frame::FrameSpec& spec, const image::LayerStack& layers) {
  return picture::NeedsDeferredShading(spec) && layers.empty() && !frame::HasSampleCaps(spec) &&
         !frame::ShowsValues(spec);
}

// Returns true if planes are drawn after the picture of a piece in this window, because its pixels
// don't give them. With layers it may be that none is: normals are known if no layer shows.
bool MayNeedPlanesAfter(const frame::FrameSpec& spec, const frame::DrawnWindow& window) {
  const bool keeps_normals = window.is_picture_of(spec) && !frame::HasLayers(spec) &&
                             CarriesNormalPlane(spec, image::LayerStack());
  return (spec.output.normal && !keeps_normals) ||
         (spec.effects.samples_per_side > 1 && NeedsPlanes(spec.output, FrameOutput()));
}

// Adds the contents of a band.
void Unite(const picture::PictureContents& of_band, picture::PictureContents* contents) {
  contents->shown |= of_band.shown;
  contents->without_values |= of_band.without_values;
  contents->has_caps_without_samples |= of_band.has_caps_without_samples;
}

// Records the colouring of each surface, and of caps.
void AddColorings(const frame::FrameSpec& spec, const volume::GridGeometry& geometry,
                  const picture::PictureContents& contents,
                  v1::RenderIsosurfaceResponse* response) {
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    std::optional<frame::ColorBy> color_by = spec.surfaces[i].color_by;
    if (!color_by.has_value()) {
      continue;
    }
    if (color_by->quantity != frame::ColorBy::Quantity::kNormal) {
      color_by->range = picture::ColorRangeOf(*color_by, geometry);
    }
    v1::SurfaceColoring* const coloring = response->add_colorings();
    coloring->set_surface_index(static_cast<std::int32_t>(i));
    *coloring->mutable_color_by() = wire::ToProto(*color_by);
    if (spec.surfaces[i].shows_field()) {
      *coloring->mutable_nan_color() = wire::ToProto(frame::NanColorOf(spec, color_by->map));
      coloring->set_shows_nan(contents.without_values.test(i));
    }
  }
  if (frame::HasSampleCaps(spec)) {
    v1::CapsColoring* const coloring = response->mutable_caps_coloring();
    *coloring->mutable_caps() = wire::ToProto(*spec.caps);
    *coloring->mutable_nan_color() = wire::ToProto(frame::NanColorOf(spec, *spec.caps->map));
    coloring->set_shows_nan(contents.has_caps_without_samples);
  }
}

void MoveInto(FrameOutput output, frame::ImageFormat format,
              v1::RenderIsosurfaceResponse* response) {
  if (const Encoding encoding = EncodingOf(format); encoding.field != nullptr) {
    *(response->*encoding.field)() = std::move(output.image);
  }
  response->set_depth(std::move(output.depth));
  response->set_surface_index(std::move(output.surface_index));
  response->set_position(std::move(output.position));
  response->set_normal(std::move(output.normal));
  response->set_depth_bounds(std::move(output.depth_bounds));
}

}  // namespace

absl::StatusOr<std::unique_ptr<PictureJob>> PictureJob::Admit(FrameRunner* runner,
                                                              std::shared_ptr<FrameTicket> ticket,
                                                              const Request& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(AskedFrame asked, wire::AskedFrameFromProto(request));
  return Admit(runner, std::move(ticket), std::move(asked), /*depth_grid_side=*/0);
}

absl::StatusOr<std::unique_ptr<PictureJob>> PictureJob::Admit(FrameRunner* runner,
                                                              std::shared_ptr<FrameTicket> ticket,
                                                              AskedFrame asked, int depth_grid_side,
                                                              std::optional<CoarserLevel> coarser) {
  ISOSCOPE_RETURN_IF_ERROR(ticket->TakePlace(asked.spec, /*may_band=*/true));
  return std::unique_ptr<PictureJob>(
      new PictureJob(runner, std::move(ticket), std::move(asked), depth_grid_side, coarser));
}

PictureJob::PictureJob(FrameRunner* runner, std::shared_ptr<FrameTicket> ticket, AskedFrame asked,
                       int depth_grid_side, std::optional<CoarserLevel> coarser)
    : runner_(*runner),
      ticket_(std::move(ticket)),
      asked_(std::move(asked)),
      depth_grid_side_(depth_grid_side),
      coarser_(coarser) {
  if (asked_.with_trace) {
    // The agents of the frame may have three times as many spans.
    trace_ = std::make_unique<Trace>(
        std::min(runner_.state().memory.max_trace_spans() / 4, base::TraceRecorder::kMaxSpans));
  }
}

FrameIdentity PictureJob::Identity() {
  FrameIdentity identity = ticket_->Identity();
  if (trace_ != nullptr && has_details_) {
    identity.trace = &trace_->recorder;
    identity.trace_zero = trace_->zero;
    identity.agent_traces = &trace_->of_agents;
  }
  return identity;
}

void PictureJob::ReleaseImages() {
  image_ = image::FrameImage();
  drawn_ = image::FrameImage();
  layers_ = image::LayerStack();
}

absl::Status PictureJob::RunIf(Begins begins, Response* response,
                               absl::FunctionRef<void()> on_drawn) {
  return RunWork(asked_.spec, [&] { return TryRun(&begins, response, on_drawn); });
}

absl::Status PictureJob::Run(Response* response, absl::FunctionRef<void()> on_drawn) {
  return RunWork(asked_.spec, [&]() -> absl::Status {
    const base::TraceTime begin = trace_ != nullptr ? base::TraceClock::now() : base::TraceTime();
    ISOSCOPE_RETURN_IF_ERROR(TryRun(/*begins=*/nullptr, response, on_drawn));
    if (trace_ != nullptr) {
      AddTrace(begin, response);
    }
    return absl::OkStatus();
  });
}

absl::Status PictureJob::RunWork(const frame::FrameSpec& spec,
                                 absl::FunctionRef<absl::Status()> work) {
  return ticket_->Run(spec, cost_, [&] {
    absl::Status status = base::OrNoMemory("the frame", work);
    runner_.EndCalls(ticket_->Identity(), &following_);
    return status;
  });
}

void PictureJob::AddTrace(base::TraceTime begin, Response* response) {
  base::TraceRecorder& recorder = trace_->recorder;
  recorder.NameThisThread("frame");
  recorder.AddTo("queue", "queue", trace_->zero, begin);
  recorder.Add("frame", begin, base::TraceClock::now());
  v1::FrameTrace* const trace = response->mutable_trace();
  trace->set_frame_number(ticket_->Identity().number);
  trace->set_request_id(ticket_->request().request_id());
  *trace->add_processes() = wire::ToProto(recorder.Get(), trace_->zero);
  trace->mutable_processes(0)->set_name("coordinator");
  for (v1::ProcessTrace& of_agent : trace_->of_agents) {
    if (!of_agent.name().empty()) {
      *trace->add_processes() = std::move(of_agent);
    }
  }
}

absl::Status PictureJob::TryRun(const Begins* begins, Response* response,
                                absl::FunctionRef<void()> on_drawn) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FrameTarget target,
                            runner_.Prepare(ticket_.get(), &asked_, recorder(), coarser_));
  parts_ = target.parts;
  if (begins != nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(facts_, FindFacts(target));
    if (!(*begins)(facts_)) {
      ticket_->PutOff();
      put_off_.emplace(target);
      return absl::OkStatus();
    }
  }
  FrameOutput output;
  if (asked_.spec.output.is_drawn()) {
    ISOSCOPE_RETURN_IF_ERROR(RenderInRanges(target, on_drawn, &output));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(FindRanges(target));  // which the answer tells
  }
  return Complete(target, std::move(output), response);
}

absl::Status PictureJob::Complete(const FrameTarget& target, FrameOutput output,
                                  Response* response) {
  NoteDrawn(target);
  if (asked_.spec.output.is_drawn()) {
    ISOSCOPE_RETURN_IF_ERROR(runner_.AddMissingShards(Identity(), asked_, target, parts_, &cost_));
    ISOSCOPE_RETURN_IF_ERROR(FindNotes(target));
    ISOSCOPE_RETURN_IF_ERROR(FindUnresolved(target));
  }
  ISOSCOPE_RETURN_IF_ERROR(FindBounds(target, &output));
  ISOSCOPE_RETURN_IF_ERROR(ticket_->CheckAnswerBytes(output.size_bytes()));
  ticket_->CountAnswer(output.size_bytes());
  FillResponse(target, std::move(output), response);
  return absl::OkStatus();
}

// A picture that loses parts has no values of these in its ranges, either.
absl::Status PictureJob::RenderInRanges(const FrameTarget& target,
                                        absl::FunctionRef<void()> on_drawn, FrameOutput* output) {
  const AskedFrame asked = asked_;
  for (;;) {
    ISOSCOPE_RETURN_IF_ERROR(FindRanges(target));
    const std::size_t part_count = parts_.size();
    ISOSCOPE_RETURN_IF_ERROR(RenderOutput(target, on_drawn, output));
    if (parts_.size() == part_count || !wire::HasVisibleRanges(asked.spec)) {
      return absl::OkStatus();
    }
    StartAgain(output);
    asked_ = asked;
  }
}

void PictureJob::FillResponse(const FrameTarget& target, FrameOutput output,
                              Response* response) const {
  *response->mutable_camera() = wire::ToProto(*asked_.spec.camera);
  *response->mutable_extent() = wire::ToProto(target.view.image_size());
  if (target.selected.selection.has_value()) {
    *response->mutable_selection() = *target.selected.selection;
  }
  if (target.selected.time.has_value()) {
    response->set_time(*target.selected.time);
  }
  *response->mutable_statistics() = ToProto(cost_);
  response->mutable_statistics()->set_level(target.level);
  if (asked_.level.has_value() || coarser_.has_value()) {
    *response->mutable_drawn_level() = ToProto(facts_);
  }
  AddColorings(asked_.spec, target.whole, contents_, response);
  response->mutable_notes()->Assign(notes_.begin(), notes_.end());
  MoveInto(std::move(output), asked_.spec.output.image_format, response);
}

// Only the facts that tell the level cost nothing.
void PictureJob::NoteDrawn(const FrameTarget& target) {
  facts_.level = target.level;
  facts_.asked_level = target.asked_level;
  facts_.coarsest_level = target.coarsest_level;
  facts_.spacing_px = target.spacing_px;
  facts_.spacing = view::WorldSpacing(target.view.geometry());
  facts_.active_bytes = BytesOfBlocks(target, cost_.total.active_block_count);
}

v1::DrawnLevel ToProto(const FrameFacts& facts) {
  v1::DrawnLevel drawn;
  drawn.set_level(facts.level);
  drawn.set_max_spacing_px(facts.spacing_px);
  *drawn.mutable_spacing() = wire::ToProto(facts.spacing);
  return drawn;
}

absl::Status PictureJob::FindNotes(const FrameTarget& target) {
  // The blocks of missing shards may hold what does not show.
  if (!asked_.with_notes || !cost_.missing_shards.empty()) {
    return absl::OkStatus();
  }
  ReleaseImages();
  const base::TraceScope trace(recorder(), "notes");
  const FrameIdentity identity = Identity();
  absl::StatusOr<std::vector<v1::SurfaceNote>> notes = NotesOf({.runner = &runner_,
                                                                .identity = &identity,
                                                                .spec = &asked_.spec,
                                                                .target = &target,
                                                                .parts = &parts_,
                                                                .band = band_,
                                                                .shown = contents_.shown});
  if (!notes.ok()) {
    base::LogWarning("notes_failed",
                     {{"request", ticket_->request().request_id()}, {"status", notes.status()}});
    return absl::IsCancelled(notes.status()) ? notes.status() : absl::OkStatus();
  }
  notes_ = *std::move(notes);
  return absl::OkStatus();
}

// Agents read the level's active blocks for a number that is not known yet. Only frames that ask for it
// wait for that; others tell what is known.
absl::Status PictureJob::FindUnresolved(const FrameTarget& target) {
  const frame::FrameSpec& spec = asked_.spec;
  if (spec.level == 0 || !cost_.missing_shards.empty()) {
    return absl::OkStatus();
  }
  const base::TraceScope trace(recorder(), "unresolved blocks");
  const FrameIdentity identity = Identity();
  const isoscope::v1::Dataset& dataset = target.dataset->dataset;
  std::int64_t sum = 0;
  for (const volume::InsideRule& rule : frame::RulesOf(spec)) {
    const std::string key = UnresolvedCounts::KeyOf(dataset.dataset_id(), rule, spec.level);
    std::optional<std::int64_t> count = runner_.unresolved_counts().Find(key);
    if (!count.has_value() && !asked_.with_unresolved_count) {
      return absl::OkStatus();
    }
    if (!count.has_value()) {
      const QueryOutcome<std::int64_t> outcome =
          AskUnresolved({dataset.dataset_id(), parts_}, dataset.block_count(), spec.level, rule,
                        *identity.request, *identity.cancellation);
      runner_.state().ReportQuery(*identity.request, outcome.report);
      if (!outcome.result.ok()) {
        base::LogWarning("unresolved_blocks_failed", {{"request", identity.request->request_id()},
                                                      {"status", outcome.result.status()}});
        return absl::IsCancelled(outcome.result.status()) ? outcome.result.status()
                                                          : absl::OkStatus();
      }
      count = *outcome.result;
      runner_.unresolved_counts().Insert(key, *count);
    }
    sum += *count;
  }
  cost_.unresolved_block_count = sum;
  return absl::OkStatus();
}

// All answers at a time have at most frame::kMaxBoundsPixels, for which FrameBytes counts.
absl::Status PictureJob::FindBounds(const FrameTarget& target, FrameOutput* output) {
  if (!asked_.spec.output.depth_bounds) {
    return absl::OkStatus();
  }
  ReleaseImages();
  const base::TraceScope trace(recorder(), "depth bounds");
  const FrameIdentity identity = Identity();
  const view::Region whole = target.view.region();
  const auto width = static_cast<std::size_t>(whole.width_px);
  output->depth_bounds.reserve(width * static_cast<std::size_t>(whole.height_px) *
                               frame::kDepthBoundsBytes);
  const int rows = std::max(static_cast<int>(frame::kMaxBoundsPixels / parts_.size() / width), 1);
  frame::FrameSpec of_rows = asked_.spec;
  of_rows.level = 0;
  for (int y = 0; y < whole.height_px; y += rows) {
    of_rows.region =
        view::Region{whole.x, whole.y + y, whole.width_px, std::min(rows, whole.height_px - y)};
    const QueryOutcome<visibility::DepthBounds> outcome =
        AskDepthBounds({target.dataset->dataset.dataset_id(), parts_}, of_rows, *identity.request,
                       *identity.cancellation);
    runner_.state().ReportQuery(*identity.request, outcome.report);
    ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
    AppendBounds(*outcome.result, target.view, &output->depth_bounds);
  }
  return absl::OkStatus();
}

// Forgets what was drawn.
void PictureJob::StartAgain(FrameOutput* output) {
  ReleaseImages();
  *output = FrameOutput();
  cost_ = FrameCost();
  contents_ = {};
  band_ = frame::ImageSizeOf(asked_.spec);
  has_details_ = true;
  if (trace_ != nullptr) {
    trace_->of_agents.clear();
  }
  depth_grid_builder_.reset();
  // With several samples the drawn image has the same content at a finer step; with a margin it has
  // more.
  const frame::DrawnWindow window = frame::DrawnWindowOf(asked_.spec);
  if (depth_grid_side_ > 0 &&
      (window.is_picture_of(asked_.spec) || !asked_.spec.region.has_value())) {
    depth_grid_builder_.emplace(window.image_size(), depth_grid_side_);
  }
}

absl::Status PictureJob::RenderAtOnce(const FrameTarget& target, absl::FunctionRef<void()> on_drawn,
                                      FrameOutput* output) {
  const view::Viewport size = frame::ImageSizeOf(asked_.spec);
  const Piece whole{
      .spec = asked_.spec, .target = target, .band = {0, 0, size.width_px, size.height_px}};
  const bool has_picture = asked_.spec.output.image_format != frame::ImageFormat::kNone;
  for (;;) {
    if (has_picture) {
      ISOSCOPE_RETURN_IF_ERROR(RenderPicture(whole, on_drawn, output));
    }
    const std::size_t part_count = parts_.size();
    if (NeedsPlanes(asked_.spec.output, *output)) {
      ReleaseImages();
      ISOSCOPE_RETURN_IF_ERROR(RenderPlanes(whole, output));
    }
    if (!has_picture || parts_.size() == part_count) {
      break;
    }
    // The picture has shards that the planes lack.
    StartAgain(output);
  }
  if (asked_.spec.output.image_format == frame::ImageFormat::kPng) {
    cost_.png_bytes = static_cast<std::int64_t>(output->image.size());
  }
  return absl::OkStatus();
}

// Draws picture and planes of a band, and joins them to those before it.
absl::Status PictureJob::RenderBand(const Piece& piece, absl::FunctionRef<void()> on_drawn) {
  FrameOutput output;
  if (piece.spec.output.image_format != frame::ImageFormat::kNone) {
    ISOSCOPE_RETURN_IF_ERROR(RenderPicture(piece, on_drawn, &output));
  }
  ReleaseImages();
  if (NeedsPlanes(piece.spec.output, output)) {
    ISOSCOPE_RETURN_IF_ERROR(RenderPlanes(piece, &output));
    ReleaseImages();
  }
  const base::MonotonicTime encode_start = base::MonotonicNow();
  const base::TraceScope trace(recorder(), "join band");
  piece.joiner->AddPlanes(piece.band, output);
  absl::Status encoded =
      base::RunIn(runner_.state().arena.get(), [&] { return piece.joiner->EncodeRows(); });
  cost_.encode = cost_.encode.value_or(absl::ZeroDuration()) + base::MonotonicNow() - encode_start;
  return encoded;
}

// Draws the picture, and fills the planes that its pixels give: all but normals, with one sample.
absl::Status PictureJob::RenderPicture(const Piece& piece, absl::FunctionRef<void()> on_drawn,
                                       FrameOutput* output) {
  const frame::DrawnWindow window = frame::DrawnWindowOf(piece.spec);
  std::optional<FrameTarget> larger;
  if (!window.is_picture_of(piece.spec)) {
    larger = piece.target;
    ISOSCOPE_ASSIGN_OR_RETURN(
        larger->view, piece.target.ViewOf(*piece.spec.camera, window.viewport, window.region));
  }
  const FrameTarget& drawn = larger.has_value() ? *larger : piece.target;
  ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result, Draw(piece, drawn, window, Content::kPicture));
  cost_ = CostOf(result);
  if (piece.drawn != nullptr) {
    piece.drawn->Add(result);
  }
  drawn_ = std::move(result.image);
  layers_ = std::move(result.layers);
  on_drawn();
  const base::MonotonicTime encode_start = base::MonotonicNow();
  ISOSCOPE_RETURN_IF_ERROR(ticket_->cancellation().Check());
  const base::TraceScope trace(recorder(), "finish picture");
  ISOSCOPE_RETURN_IF_ERROR(base::RunIn(runner_.state().arena.get(), [&] {
    return FinishAndEncode(piece, window, drawn.view, output);
  }));
  cost_.encode = base::MonotonicNow() - encode_start;
  return absl::OkStatus();
}

// Takes the depths of the drawn image, before they are finished.
void PictureJob::AddToDepthGrid(const Piece& piece, const frame::DrawnWindow& window,
                                const view::View& drawn_view) {
  if (!depth_grid_builder_.has_value()) {
    return;
  }
  const int side = piece.spec.effects.samples_per_side;
  depth_grid_builder_->Add({side * piece.band.x, side * piece.band.y, side * piece.band.width_px,
                            side * piece.band.height_px},
                           drawn_, drawn_view, window.begin_x, window.begin_y);
}

// Finishes and encodes the pixels that were drawn in `window`, in the arena of the caller.
absl::Status PictureJob::FinishAndEncode(const Piece& piece, const frame::DrawnWindow& window,
                                         const view::View& drawn_view, FrameOutput* output) {
  const frame::FrameSpec& spec = piece.spec;
  if (spec.output.normal && window.is_picture_of(spec) && CarriesNormalPlane(spec, layers_)) {
    output->normal = NormalPlane(drawn_);
  }
  AddToDepthGrid(piece, window, drawn_view);
  base::TraceScope shade(recorder(), "shade and blend");
  FinishedPicture finished = FinishPicture({.spec = &spec,
                                            .window = &window,
                                            .drawn_view = &drawn_view,
                                            .order = piece.target.order,
                                            .layers = &layers_,
                                            .images = runner_.state().images.get(),
                                            .finds_shown_surfaces = asked_.with_notes},
                                           &drawn_);
  image_ = std::move(finished.image);
  Unite(finished.contents, &contents_);
  shade.End();
  cost_.truncated_pixel_count = finished.truncated_pixel_count;
  if (piece.joiner != nullptr) {
    piece.joiner->AddPicture(piece.band, image_);
  } else {
    const base::TraceScope encode(recorder(), EncodingOf(spec.output.image_format).name);
    ISOSCOPE_ASSIGN_OR_RETURN(output->image, EncodePicture(image_, spec));
  }
  if (spec.effects.samples_per_side == 1) {
    FillPlanes(image_, spec, piece.target.view, piece.target.order, output);
  }
  return absl::OkStatus();
}

// Draws the planes that are still missing, with one sample. A frame whose pixels carry normals has
// the same depths and surfaces as one with colours.
absl::Status PictureJob::RenderPlanes(const Piece& piece, FrameOutput* output) {
  const frame::FrameSpec& spec = piece.spec;
  const frame::DrawnWindow plain{.viewport = spec.viewport, .region = spec.region};
  const bool is_first = spec.output.image_format == frame::ImageFormat::kNone;
  ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result, Draw(piece, piece.target, plain, Content::kPlanes));
  if (is_first) {
    cost_ = CostOf(result);
    if (piece.drawn != nullptr) {
      piece.drawn->Add(result);
    }
  }
  image_ = std::move(result.image);
  layers_ = std::move(result.layers);
  const base::MonotonicTime encode_start = base::MonotonicNow();
  ISOSCOPE_RETURN_IF_ERROR(ticket_->cancellation().Check());
  const base::TraceScope trace(recorder(), "planes");
  base::RunIn(runner_.state().arena.get(), [&] {
    if (is_first && asked_.with_notes) {
      Unite(picture::FindContents(
                {.spec = &spec, .order = piece.target.order, .image = &image_, .layers = &layers_},
                {0, 0, image_.width, image_.height}, /*with_shown=*/true),
            &contents_);
    }
    picture::ShowNearest(layers_, &image_);
    if (spec.output.normal) {
      output->normal = NormalPlane(image_);
    }
    if (is_first || spec.effects.samples_per_side > 1) {
      FillPlanes(image_, spec, piece.target.view, piece.target.order, output);
    }
  });
  if (is_first) {
    cost_.encode = base::MonotonicNow() - encode_start;
  }
  return absl::OkStatus();
}

// Lets the agents draw a window. It is a frame of its own, without effects.
absl::StatusOr<FrameResult> PictureJob::Draw(const Piece& piece, const FrameTarget& target,
                                             const frame::DrawnWindow& window, Content content) {
  AskedFrame of_window = asked_;
  frame::FrameSpec& spec = of_window.spec;
  spec.viewport = window.viewport;
  spec.region = window.region;
  DrawingContext context = piece.context;
  context.following = &following_;
  if (content == Content::kPicture) {
    context.others_follow |= MayNeedPlanesAfter(piece.spec, window);
    spec.effects = {};
    spec.sends_normals = picture::NeedsDeferredShading(spec);
    spec.sends_map_steps = frame::ShowsValues(spec);
  } else {
    const bool with_normals = spec.output.normal;
    spec = frame::WithoutLook(std::move(spec), with_normals);
    if (asked_.spec.output.image_format != frame::ImageFormat::kNone) {
      context.drawn = nullptr;  // the picture counts
    }
  }
  const base::TraceScope trace(recorder(), "agents");
  return runner_.Run(Identity(), of_window, target, &parts_, context);
}

}  // namespace isoscope::server
