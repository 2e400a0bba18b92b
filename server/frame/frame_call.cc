#include "server/frame/frame_call.h"

#include <algorithm>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"

#include "core/base/log.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/picture/deferred_shading.h"
#include "core/picture/layer_blending.h"
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/trace_convert.h"
#include "server/frame/agent_queries.h"
#include "server/frame/render_statistics.h"
#include "server/picture/picture_finish.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// The room in a message for what is neither picture nor plane.
constexpr std::size_t kOtherFieldsBytes = base::kMiB;

// Of an answer in parts, those that are copied to be sent.
constexpr std::size_t kPartsUnderWayBytes = 2 * base::kMiB;

// Returns when a frame that began at `start` must end so that its client still hears which agent is
// late. A client whose own clock runs out first learns nothing.
absl::Time AnswerBefore(absl::Time client_deadline, absl::Time start) {
  constexpr absl::Duration kMaxMargin = absl::Milliseconds(200);  // an answer on a slow network
  constexpr int kMarginShare = 10;                                // of the client's time
  const absl::Duration margin = std::min((client_deadline - start) / kMarginShare, kMaxMargin);
  return client_deadline - std::max(margin, absl::ZeroDuration());
}

std::size_t RawResponseBytes(const frame::FrameSpec& spec) {
  const view::Viewport size = frame::ImageSizeOf(spec);
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px) *
         frame::RawBytesPerPixel(spec.output);
}

absl::Status CheckMessageBytes(std::size_t bytes) {
  if (bytes + kOtherFieldsBytes <= static_cast<std::size_t>(rpc::kMaxMessageBytes)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "output: picture and planes have ", bytes, " bytes and one message holds at most ",
      rpc::kMaxMessageBytes, ": ask RenderIsosurfaceStream, or for a region or fewer planes"));
}

// The name of a picture's encoding in a trace.
const char* NameOf(frame::ImageFormat format) {
  switch (format) {
    case frame::ImageFormat::kPng:
      return "png";
    case frame::ImageFormat::kJpeg:
      return "jpeg";
    case frame::ImageFormat::kRgba8:
      return "raw picture";
    case frame::ImageFormat::kNone:
      break;
  }
  return "no picture";
}

// Whether planes were asked for that `output` does not have yet.
bool NeedsPlanes(const frame::OutputSpec& wanted, const FrameOutput& output) {
  return (wanted.depth && output.depth.empty()) ||
         (wanted.surface_index && output.surface_index.empty()) ||
         (wanted.position && output.position.empty()) || (wanted.normal && output.normal.empty());
}

// Caps with the samples have a colour, but no normal. Planes and picks ask for caps of the surface.
void ShowSurfacesOnCaps(frame::FrameSpec* spec, v1::RenderIsosurfaceRequest* request) {
  if (spec->caps.has_value()) {
    spec->caps = frame::ClipCaps();
    request->mutable_caps()->Clear();
  }
}

// Tells how the surfaces were coloured.
void AddColorings(const frame::FrameSpec& spec, const volume::GridGeometry& geometry,
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
    *coloring->mutable_color_by() = rpc::ToProto(*color_by);
  }
}

}  // namespace

FrameCall::FrameCall(FrameRunner* runner, FrameOrigin origin,
                     const v1::RenderIsosurfaceRequest& request, Delivery delivery,
                     absl::Time client_deadline, absl::Duration max_duration)
    : runner_(runner),
      origin_(std::move(origin)),
      request_(request),
      delivery_(delivery),
      start_(absl::Now()),
      cancellation_(std::min(AnswerBefore(client_deadline, start_), start_ + max_duration)) {
  if (request.with_trace()) {
    trace_ = std::make_unique<base::TraceRecorder>(runner_->max_own_spans());
    trace_zero_ = base::TraceClock::now();
  }
}

absl::Status FrameCall::Admit() {
  ISOSCOPE_ASSIGN_OR_RETURN(spec_, rpc::FrameSpecFromProto(request_));
  return CountRefusal(TakePlace());
}

absl::Status FrameCall::AdmitPick(const v1::PickSurfaceRequest& pick) {
  ISOSCOPE_ASSIGN_OR_RETURN(rpc::PickSpec converted, rpc::PickSpecFromProto(pick));
  if (converted.request.with_trace()) {
    return absl::InvalidArgumentError(
        "frame.with_trace is set: must be unset, picks have no trace");
  }
  pixels_ = std::move(converted.pixels);
  request_ = std::move(converted.request);
  spec_ = std::move(converted.frame);
  return CountRefusal(TakePlace());
}

absl::Status FrameCall::CountRefusal(absl::Status status) const {
  if (absl::IsResourceExhausted(status)) {
    runner_->metrics()->CountRefused(caller_.name());
  }
  return status;
}

absl::Status FrameCall::TakePlace() {
  if (delivery_ == Delivery::kWhole) {
    ISOSCOPE_RETURN_IF_ERROR(CheckMessageBytes(RawResponseBytes(spec_)));
  }
  ISOSCOPE_RETURN_IF_ERROR(
      caller_.CheckViewport(spec_.viewport.width_px, spec_.viewport.height_px));
  ISOSCOPE_RETURN_IF_ERROR(TakeShare());
  absl::StatusOr<Admission::Place> place =
      runner_->Admit(caller_.QueueKey(origin_.client), spec_, delivery_, trace_ != nullptr);
  if (!place.ok()) {
    caller_.ReturnFrame();
    slot_.reset();
    return place.status();
  }
  ticket_ = place->ticket();
  place_.emplace(*std::move(place));
  const view::Viewport size = frame::ImageSizeOf(spec_);
  on_board_.emplace(runner_->board()->Add({.request_id = origin_.request.request_id(),
                                           .client = origin_.client,
                                           .dataset = request_.dataset(),
                                           .width_px = size.width_px,
                                           .height_px = size.height_px,
                                           .arrival = start_}));
  return absl::OkStatus();
}

absl::Status FrameCall::TakeShare() {
  CoordinatorMetrics* const metrics = runner_->metrics();
  ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kBytes, caller_.CheckBytes()));
  absl::StatusOr<CallerSlot> slot = caller_.Begin(CallerUse::kFrame);
  ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kFrames, slot.status()));
  absl::Status rate = metrics->CountRefusal(TokenLimit::kFrameRate, caller_.TakeFrame(is_moving_));
  if (!rate.ok()) {
    metrics->rate_limited_frames.Add();
    return rate;
  }
  slot_.emplace(*std::move(slot));
  return absl::OkStatus();
}

void FrameCall::Schedule(std::function<void()> work) {
  const Admission::Ticket ticket = ticket_;
  runner_->admission()->Schedule(ticket, cancellation_.deadline(),
                                 [this, work = std::move(work)](const absl::Status& turn) {
                                   turn_ = turn;
                                   work();
                                 });
  if (cancellation_.is_cancelled()) {  // before there was anything to leave
    runner_->admission()->Leave(ticket);
  }
}

void FrameCall::Cancel() {
  cancellation_.Cancel();
  runner_->admission()->Leave(ticket_);
}

AuditRecord FrameCall::audit_record() const {
  return {.caller = caller_.name(),
          .certificate = origin_.certificate,
          .peer = origin_.client,
          .dataset = dataset_name_.empty() ? request_.dataset() : dataset_name_,
          .dataset_id = dataset_id_};
}

void FrameCall::BeginWork() {
  on_board_->step()->store(FrameStep::kPreparing, std::memory_order_relaxed);
  runner_->metrics()->queue_wait.Observe(absl::Now() - start_);
}

void FrameCall::EndWork(std::int64_t frame_number, const absl::Status& status,
                        const v1::RenderStatistics& statistics) {
  Log(frame_number, status, statistics);
  CountEnd(status);
  if (status.ok()) {
    CountSteps(statistics);
  }
  on_board_.reset();
  // Before the client gets its answer: its next request finds both free.
  place_.reset();
  slot_.reset();
}

void FrameCall::CountEnd(const absl::Status& status) const {
  CoordinatorMetrics* const metrics = runner_->metrics();
  if (absl::IsResourceExhausted(turn_)) {
    metrics->refused_frames.Add();
    metrics->displaced_frames.Add();
    caller_.ReturnFrame();
    metrics->CountRefused(caller_.name());
    return;
  }
  if (absl::IsDeadlineExceeded(turn_)) {
    metrics->expired_frames.Add();
  }
  metrics->CountFrame(status, absl::Now() - start_, is_moving_, caller_.name());
}

void FrameCall::CountSteps(const v1::RenderStatistics& statistics) const {
  CoordinatorMetrics* const metrics = runner_->metrics();
  const v1::StepDurations& durations = statistics.durations();
  metrics->occluder_selection.Observe(
      rpc::DurationFromProto(durations.occluder_selection_duration()));
  metrics->occluder_rendering.Observe(
      rpc::DurationFromProto(durations.occluder_rendering_duration()));
  metrics->visibility_culling.Observe(
      rpc::DurationFromProto(durations.visibility_culling_duration()));
  metrics->composite.Observe(rpc::DurationFromProto(durations.composite_duration()));
  metrics->encode.Observe(rpc::DurationFromProto(durations.encode_duration()));
  metrics->network_bytes.Add(statistics.network_bytes());
}

FrameIdentity FrameCall::IdentityOf(std::int64_t frame_number) {
  return {.number = frame_number,
          .request = &origin_.request,
          .step = on_board_->step(),
          .trace = trace_.get(),
          .trace_zero = trace_zero_,
          .agent_traces = &agent_traces_};
}

absl::Status FrameCall::Render(v1::RenderIsosurfaceResponse* response) {
  BeginWork();
  const base::TraceTime begin = trace_ != nullptr ? base::TraceClock::now() : base::TraceTime();
  const std::int64_t frame_number = runner_->NextFrameNumber();
  const absl::Status status = base::OrNoMemory(
      "the frame", [&] { return turn_.ok() ? TryRender(frame_number, response) : turn_; });
  if (trace_ != nullptr && status.ok()) {
    AddTrace(frame_number, begin, response);
  }
  EndWork(frame_number, status, response->statistics());
  return status;
}

void FrameCall::AddTrace(std::int64_t frame_number, base::TraceTime begin,
                         v1::RenderIsosurfaceResponse* response) {
  trace_->NameThisThread("frame");
  trace_->AddTo("queue", "queue", trace_zero_, begin);
  trace_->Add("frame", begin, base::TraceClock::now());
  v1::FrameTrace* const trace = response->mutable_trace();
  trace->set_frame_number(frame_number);
  trace->set_request_id(origin_.request.request_id());
  *trace->add_processes() = rpc::ToProto(trace_->Get(), trace_zero_);
  trace->mutable_processes(0)->set_name("coordinator");
  for (v1::ProcessTrace& of_agent : agent_traces_) {
    if (!of_agent.name().empty()) {
      *trace->add_processes() = std::move(of_agent);
    }
  }
}

absl::Status FrameCall::Pick(v1::PickSurfaceResponse* response) {
  BeginWork();
  const std::int64_t frame_number = runner_->NextFrameNumber();
  const absl::Status status = base::OrNoMemory(
      "the pick", [&] { return turn_.ok() ? TryPick(frame_number, response) : turn_; });
  EndWork(frame_number, status, response->statistics());
  return status;
}

void FrameCall::KeepMemoryOfAnswer(std::size_t answer_bytes) {
  if (memory_.has_value()) {
    // gRPC copies a whole answer, and of one in parts a few parts.
    memory_->ShrinkTo(answer_bytes +
                      (delivery_ == Delivery::kWhole ? answer_bytes : kPartsUnderWayBytes));
  }
}

std::optional<base::MemoryBudget::Reservation> FrameCall::TakeMemory(std::size_t bytes) {
  if (memory_.has_value()) {
    memory_->ShrinkTo(bytes);
  }
  std::optional<base::MemoryBudget::Reservation> taken = std::move(memory_);
  memory_.reset();
  return taken;
}

absl::Status FrameCall::Reserve() {
  const base::TraceScope trace(trace_.get(), "memory");
  const absl::Time start = absl::Now();
  const absl::Cleanup count = [&] { runner_->metrics()->memory_wait.Observe(absl::Now() - start); };
  ISOSCOPE_ASSIGN_OR_RETURN(
      base::MemoryBudget::Reservation memory,
      runner_->ReserveMemory(spec_, delivery_, trace_ != nullptr, cancellation_));
  memory_.emplace(std::move(memory));
  return absl::OkStatus();
}

absl::Status FrameCall::TryRender(std::int64_t frame_number,
                                  v1::RenderIsosurfaceResponse* response) {
  ISOSCOPE_RETURN_IF_ERROR(Reserve());
  base::TraceScope find(trace_.get(), "find dataset");
  ISOSCOPE_ASSIGN_OR_RETURN(
      const FrameTarget target,
      runner_->FindTarget(&request_, &spec_, origin_.request, cancellation_, caller_));
  find.End();
  dataset_name_ = target.dataset->dataset.name();
  dataset_id_ = target.dataset->dataset.dataset_id();
  ISOSCOPE_RETURN_IF_ERROR(rpc::ResolveColorRanges(target.dataset->dataset, &request_, &spec_));
  *response->mutable_camera() = request_.camera();
  *response->mutable_extent() = rpc::ToProto(target.view.image_size());
  AddColorings(spec_, target.view.geometry(), response);

  parts_ = target.parts;
  FrameOutput output;
  ISOSCOPE_RETURN_IF_ERROR(
      RenderOutput(frame_number, target, &output, response->mutable_statistics()));
  ISOSCOPE_RETURN_IF_ERROR(AddMissingShards(target, response->mutable_statistics()));
  if (delivery_ == Delivery::kWhole) {
    ISOSCOPE_RETURN_IF_ERROR(CheckMessageBytes(output.size_bytes()));
  }
  runner_->metrics()->response_bytes.Add(static_cast<std::int64_t>(output.size_bytes()));
  caller_.CountBytes(output.size_bytes());
  MoveInto(std::move(output), response);
  return absl::OkStatus();
}

absl::Status FrameCall::RenderOutput(std::int64_t frame_number, const FrameTarget& target,
                                     FrameOutput* output, v1::RenderStatistics* statistics) {
  const bool has_picture = spec_.output.image_format != frame::ImageFormat::kNone;
  if (has_picture) {
    ISOSCOPE_RETURN_IF_ERROR(RenderPicture(frame_number, target, output, statistics));
  }
  const std::size_t part_count = parts_.size();
  if (NeedsPlanes(spec_.output, *output)) {
    ReleaseImages();
    ISOSCOPE_RETURN_IF_ERROR(RenderPlanes(frame_number, target, output, statistics));
  }
  if (!has_picture || parts_.size() == part_count) {
    return absl::OkStatus();
  }
  // The planes lack shards that the picture has.
  ReleaseImages();
  *output = FrameOutput();
  statistics->Clear();
  return RenderOutput(frame_number, target, output, statistics);
}

absl::Status FrameCall::AddMissingShards(const FrameTarget& target,
                                         v1::RenderStatistics* statistics) {
  const v1::Dataset& dataset = target.dataset->dataset;
  const std::vector<int> missing = MissingShards(dataset.shard_count(), parts_);
  if (missing.empty()) {
    return absl::OkStatus();
  }
  const QueryOutcome<ActiveExtent> outcome =
      AskActiveBox({dataset.dataset_id(), parts_, runner_->NextTurn()}, target.layout,
                   frame::IsovaluesOf(spec_), request_.clip(), origin_.request, cancellation_);
  runner_->ReportQuery(origin_.request, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  const std::int64_t all = outcome.result->active_block_count;
  statistics->mutable_missing_shards()->Assign(missing.begin(), missing.end());
  statistics->set_active_block_coverage(
      all == 0 ? 1.0
               : static_cast<double>(statistics->active_block_count()) / static_cast<double>(all));
  runner_->metrics()->partial_frames.Add();
  return absl::OkStatus();
}

// Draws the picture, and fills the planes that its pixels give: all but normals, with one sample.
absl::Status FrameCall::RenderPicture(std::int64_t frame_number, const FrameTarget& target,
                                      FrameOutput* output, v1::RenderStatistics* statistics) {
  const frame::DrawnWindow window = frame::DrawnWindowOf(spec_);
  std::optional<FrameTarget> larger;
  if (!window.is_picture_of(spec_)) {
    larger = target;
    ISOSCOPE_ASSIGN_OR_RETURN(
        larger->view,
        view::View::Make(*spec_.camera, window.viewport, target.view.geometry(), window.region));
  }
  const FrameTarget& drawn = larger.has_value() ? *larger : target;
  ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result,
                            Draw(frame_number, drawn, window, Content::kPicture));
  *statistics = StatisticsOf(result);
  drawn_ = std::move(result.image);
  layers_ = std::move(result.layers);
  if (picture_drawn_) {
    picture_drawn_();
  }
  const absl::Time encode_start = absl::Now();
  ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
  const base::TraceScope trace(trace_.get(), "finish picture");
  ISOSCOPE_RETURN_IF_ERROR(runner_->arena()->execute([&]() -> absl::Status {
    // With normals in place of colours, the plane is there already.
    const bool shows_samples = spec_.caps.has_value() && spec_.caps->map.has_value();
    const bool has_normals = picture::NeedsDeferredShading(spec_) && layers_.empty() &&
                             !shows_samples && !frame::ShowsGradient(spec_);
    if (spec_.output.normal && has_normals && !larger.has_value()) {
      output->normal = NormalPlane(drawn_);
    }
    // With several samples what is drawn shows the same, finer; with a margin it shows more.
    if (depth_grid_side_ > 0 && (!larger.has_value() || !spec_.region.has_value())) {
      depth_grid_ = MakeDepthGrid(drawn_, drawn.view, depth_grid_side_);
    }
    base::TraceScope shade(trace_.get(), "shade and blend");
    FinishedPicture finished = FinishPicture({.spec = &spec_,
                                              .window = &window,
                                              .drawn_view = &drawn.view,
                                              .order = target.order,
                                              .layers = &layers_,
                                              .images = runner_->images()},
                                             &drawn_);
    image_ = std::move(finished.image);
    shade.End();
    statistics->set_truncated_pixel_count(finished.truncated_pixel_count);
    base::TraceScope encode(trace_.get(), NameOf(spec_.output.image_format));
    ISOSCOPE_ASSIGN_OR_RETURN(output->image, EncodePicture(image_, spec_));
    encode.End();
    if (spec_.effects.samples_per_side == 1) {
      FillPlanes(image_, spec_, target.view, target.order, output);
    }
    return absl::OkStatus();
  }));
  if (spec_.output.image_format == frame::ImageFormat::kPng) {
    statistics->set_png_bytes(static_cast<std::int64_t>(output->image.size()));
  }
  *statistics->mutable_durations()->mutable_encode_duration() =
      rpc::ToProto(absl::Now() - encode_start);
  return absl::OkStatus();
}

// Draws the planes that are still missing, with one sample. A frame whose pixels carry normals has
// the same depths and surfaces as one with colours.
absl::Status FrameCall::RenderPlanes(std::int64_t frame_number, const FrameTarget& target,
                                     FrameOutput* output, v1::RenderStatistics* statistics) {
  const frame::DrawnWindow plain{.viewport = spec_.viewport, .region = spec_.region};
  ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result,
                            Draw(frame_number, target, plain, Content::kPlanes));
  const bool is_first = spec_.output.image_format == frame::ImageFormat::kNone;
  if (is_first) {
    *statistics = StatisticsOf(result);
  }
  image_ = std::move(result.image);
  layers_ = std::move(result.layers);
  const absl::Time encode_start = absl::Now();
  ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
  const base::TraceScope trace(trace_.get(), "planes");
  runner_->arena()->execute([&] {
    picture::ShowNearest(layers_, &image_);
    if (spec_.output.normal) {
      output->normal = NormalPlane(image_);
    }
    if (is_first || spec_.effects.samples_per_side > 1) {
      FillPlanes(image_, spec_, target.view, target.order, output);
    }
  });
  if (is_first) {
    *statistics->mutable_durations()->mutable_encode_duration() =
        rpc::ToProto(absl::Now() - encode_start);
  }
  return absl::OkStatus();
}

// Lets the agents draw a window. To them it is a frame of its own, without samples and effects.
absl::StatusOr<FrameResult> FrameCall::Draw(std::int64_t frame_number, const FrameTarget& target,
                                            const frame::DrawnWindow& window, Content content) {
  frame::FrameSpec spec = spec_;
  spec.viewport = window.viewport;
  spec.region = window.region;
  spec.effects = {};
  v1::RenderIsosurfaceRequest request = request_;
  if (content == Content::kPicture) {
    spec.sends_normals = picture::NeedsDeferredShading(spec);
    spec.sends_map_steps = frame::ShowsGradient(spec);
  } else {
    spec.sends_normals = spec.output.normal;
    ShowSurfacesOnCaps(&spec, &request);
  }
  *request.mutable_viewport() = rpc::ToProto(window.viewport);
  if (window.region.has_value()) {
    *request.mutable_region() = rpc::ToProto(*window.region);
  }
  request.clear_samples();
  request.clear_ambient_occlusion();
  request.clear_silhouette();
  const base::TraceScope trace(trace_.get(), "agents");
  return runner_->Run(IdentityOf(frame_number), request, spec, target, cancellation_, &parts_);
}

void FrameCall::MoveInto(FrameOutput output, v1::RenderIsosurfaceResponse* response) const {
  switch (spec_.output.image_format) {
    case frame::ImageFormat::kPng:
      response->set_png(std::move(output.image));
      break;
    case frame::ImageFormat::kJpeg:
      response->set_jpeg(std::move(output.image));
      break;
    case frame::ImageFormat::kRgba8:
      response->set_rgba8(std::move(output.image));
      break;
    case frame::ImageFormat::kNone:
      break;
  }
  response->set_depth(std::move(output.depth));
  response->set_surface_index(std::move(output.surface_index));
  response->set_position(std::move(output.position));
  response->set_normal(std::move(output.normal));
}

absl::Status FrameCall::TryPick(std::int64_t frame_number, v1::PickSurfaceResponse* response) {
  ISOSCOPE_RETURN_IF_ERROR(Reserve());
  ISOSCOPE_ASSIGN_OR_RETURN(
      const FrameTarget target,
      runner_->FindTarget(&request_, &spec_, origin_.request, cancellation_, caller_));
  dataset_name_ = target.dataset->dataset.name();
  dataset_id_ = target.dataset->dataset.dataset_id();
  *response->mutable_camera() = request_.camera();
  spec_.sends_normals = true;
  ShowSurfacesOnCaps(&spec_, &request_);
  parts_ = target.parts;
  ISOSCOPE_ASSIGN_OR_RETURN(
      FrameResult result,
      runner_->Run(IdentityOf(frame_number), request_, spec_, target, cancellation_, &parts_));
  *response->mutable_statistics() = StatisticsOf(result);
  ISOSCOPE_RETURN_IF_ERROR(AddMissingShards(target, response->mutable_statistics()));
  image_ = std::move(result.image);
  layers_ = std::move(result.layers);
  runner_->arena()->execute([&] { picture::ShowNearest(layers_, &image_); });
  for (const rpc::PixelPosition& pixel : pixels_) {
    AddPoint(pixel, target, response);
  }
  return AskAgentsOfPoints(target, response);
}

absl::Status FrameCall::AskAgentsOfPoints(const FrameTarget& target,
                                          v1::PickSurfaceResponse* response) {
  std::vector<ShownPoint> points;
  for (const v1::PickedPoint& point : response->points()) {
    if (point.is_hit()) {
      points.push_back(
          {.position = {point.position().x(), point.position().y(), point.position().z()},
           .block_id = static_cast<volume::BlockId>(point.block_id())});
    }
  }
  if (points.empty()) {
    return absl::OkStatus();
  }
  const QueryOutcome<std::vector<PointAnswer>> outcome = AskPoints(
      {target.dataset->dataset.dataset_id(), parts_}, points, origin_.request, cancellation_);
  runner_->ReportQuery(origin_.request, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  std::size_t next = 0;
  for (v1::PickedPoint& point : *response->mutable_points()) {
    if (!point.is_hit()) {
      continue;
    }
    const PointAnswer& answer = (*outcome.result)[next++];
    if (!answer.shard_index.has_value()) {
      return absl::InternalError(
          absl::StrCat("a pixel shows block ", point.block_id(), ", which no agent has"));
    }
    point.set_shard_index(*answer.shard_index);
    if (answer.gradient.has_value()) {
      *point.mutable_gradient() = rpc::ToProto(*answer.gradient);
    }
  }
  return absl::OkStatus();
}

// Adds what one pixel shows.
void FrameCall::AddPoint(const rpc::PixelPosition& pixel, const FrameTarget& target,
                         v1::PickSurfaceResponse* response) {
  v1::PickedPoint* out = response->add_points();
  const std::optional<PixelPoint> point =
      PointAt(image_, pixel.x - spec_.region->x, pixel.y - spec_.region->y, target.view,
              target.order, spec_.sends_normals);
  if (!point.has_value()) {
    return;
  }
  out->set_is_hit(true);
  *out->mutable_position() = rpc::ToProto(point->position);
  out->set_depth(point->distance);
  out->set_surface_index(static_cast<std::int32_t>(point->surface_index));
  if (point->normal.has_value()) {
    *out->mutable_normal() = rpc::ToProto(*point->normal);
  }
  out->set_block_id(point->block_id);
}

void FrameCall::Log(std::int64_t frame_number, const absl::Status& status,
                    const v1::RenderStatistics& statistics) const {
  if (status.ok() && !logs_success_) {
    return;
  }
  const std::string duration = base::LogMilliseconds(absl::Now() - start_);
  if (status.ok()) {
    base::LogInfo(pixels_.empty() ? "frame_done" : "pick_done",
                  {{"request", origin_.request.request_id()},
                   {"frame", frame_number},
                   {"dataset", dataset_name_},
                   {"isovalues", absl::StrJoin(frame::IsovaluesOf(spec_), ",")},
                   {"width", frame::ImageSizeOf(spec_).width_px},
                   {"height", frame::ImageSizeOf(spec_).height_px},
                   {"duration_ms", duration},
                   {"triangles", statistics.triangle_count()},
                   {"agents", statistics.agents_size()},
                   {"network_bytes", statistics.network_bytes()},
                   {"caller", caller_.name()},
                   {"peer", origin_.client}});
  } else {
    base::LogWarning(pixels_.empty() ? "frame_failed" : "pick_failed",
                     {{"request", origin_.request.request_id()},
                      {"frame", frame_number},
                      {"dataset", request_.dataset()},
                      {"duration_ms", duration},
                      {"caller", caller_.name()},
                      {"peer", origin_.client},
                      {"status", status}});
  }
}

}  // namespace isoscope::server
