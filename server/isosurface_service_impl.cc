// A frame (RenderCall):
//
// 1. Start, on gRPC's thread, converts the request. An error that no state of the cluster could
//    change is answered at once. Then it counts the frame, refuses it if too many are in work or
//    wait, and queues Run.
// 2. Run, on a frame thread, finds the dataset, which may wait for a probe of the agents, and then
//    makes layout, camera and view. CAMERA_FIT_SURFACE asks an agent for the box of the surface.
// 3. RunFrame does the work with the agents (frame_coordinator). If the cache knows which blocks
//    are active, agents need not report them; otherwise their report goes into the cache.
// 4. The picture becomes a PNG, in the arena. The frame gives its place to another one before the
//    client gets the answer, so that the client's next request finds it free.
//
// The frame ends a tenth of the client's time, at most 200 ms, before the client's deadline, so
// that the client still hears which agent is late.
//
// An export (ExportCall) opens a stream to each agent and lets ExportSurface merge them, on an
// export thread. Its chunks wait in outgoing_. When 4 MiB wait for a slow client, the merge waits,
// and gRPC's flow control then stops the agents. OnCancel cancels the streams, which wakes the
// merge.

#include "server/isosurface_service_impl.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/frame/frame_spec.h"
#include "core/image/png_codec.h"
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/write_queue.h"
#include "core/view/camera.h"
#include "core/view/camera_fit.h"
#include "core/view/view.h"
#include "server/agent_client.h"
#include "server/agent_queries.h"
#include "server/frame_coordinator.h"
#include "server/render_statistics.h"
#include "server/surface_export.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// If this many bytes of chunks wait for a slow client, the merge waits too.
constexpr std::size_t kMaxQueuedExportBytes = 4 * base::kMiB;
// Room for the active blocks of some isovalues, 4 bytes a block.
constexpr std::size_t kMaxActiveBlocksBytes = 64 * base::kMiB;
// Room for images that no frame uses: four of 2048 x 2048 pixels.
constexpr std::size_t kMaxUnusedImageBytes = 192 * base::kMiB;

// Returns when a frame that began at `start` must end so that its client still hears which agent is
// late. A client whose own clock runs out first learns nothing.
absl::Time AnswerBefore(absl::Time client_deadline, absl::Time start) {
  constexpr absl::Duration kMaxMargin = absl::Milliseconds(200);  // an answer on a slow network
  constexpr int kMarginShare = 10;                                // of the client's time
  const absl::Duration margin = std::min((client_deadline - start) / kMarginShare, kMaxMargin);
  return client_deadline - std::max(margin, absl::ZeroDuration());
}

absl::StatusOr<volume::BlockLayout> LayoutOf(const isoscope::v1::Dataset& dataset,
                                             const volume::GridGeometry& geometry) {
  const isoscope::v1::Dimensions& cells = dataset.block_cells();
  return volume::BlockLayout::Make(geometry.sample_dims, {cells.x(), cells.y(), cells.z()});
}

}  // namespace

// One frame. It owns itself until gRPC is done with it. The thread that renders shares it.
class IsosurfaceServiceImpl::RenderCall final : public grpc::ServerUnaryReactor {
 public:
  static RenderCall* Start(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
                           const isoscope::v1::RenderIsosurfaceRequest* request,
                           isoscope::v1::RenderIsosurfaceResponse* response) {
    std::shared_ptr<RenderCall> call(new RenderCall(service, context, request, response));
    call->self_ = call;
    // A request that can't be right in any state of the cluster does not wait.
    absl::StatusOr<frame::FrameSpec> spec = rpc::FrameSpecFromProto(*request);
    if (!spec.ok()) {
      call->Finish(rpc::ToGrpcStatus(spec.status()));
      return call.get();
    }
    call->spec_ = *std::move(spec);
    const IsosurfaceServiceOptions& options = service->options_;
    call->is_counted_ = true;
    if (service->frame_count_.fetch_add(1) >=
            options.max_concurrent_frames + options.max_queued_frames ||
        !service->frame_executor_.TrySchedule([call] { call->Run(); })) {
      call->Finish(rpc::ToGrpcStatus(absl::ResourceExhaustedError(absl::StrCat(
          options.max_concurrent_frames, " frames are in work and ", options.max_queued_frames,
          " wait (--max-concurrent-frames, --max-queued-frames): retry later, with back-off"))));
    }
    return call.get();
  }

  ~RenderCall() override { Leave(); }

  void OnCancel() override { cancellation_.Cancel(); }
  void OnDone() override { const std::shared_ptr<RenderCall> last_use = std::move(self_); }

 private:
  RenderCall(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
             const isoscope::v1::RenderIsosurfaceRequest* request,
             isoscope::v1::RenderIsosurfaceResponse* response)
      : service_(service),
        request_(*request),
        response_(response),
        start_(absl::Now()),
        cancellation_(std::min(AnswerBefore(rpc::DeadlineOf(*context), start_),
                               start_ + service->options_.max_frame_duration)) {}

  void Run() {
    const std::int64_t frame_number = service_->next_frame_number_.fetch_add(1);
    image::FrameImage image;  // cleared for its pool once the client has its answer
    const absl::Status status = Render(frame_number, &image);
    const std::string duration = base::LogMilliseconds(absl::Now() - start_);
    if (status.ok()) {
      const isoscope::v1::RenderStatistics& statistics = response_->statistics();
      base::LogInfo("frame_done", {{"frame", frame_number},
                                   {"dataset", dataset_name_},
                                   {"isovalue", request_.isovalue()},
                                   {"width", spec_.viewport.width_px},
                                   {"height", spec_.viewport.height_px},
                                   {"duration_ms", duration},
                                   {"triangles", statistics.triangle_count()},
                                   {"agents", statistics.agents_size()},
                                   {"network_bytes", statistics.network_bytes()}});
    } else {
      base::LogWarning("frame_failed", {{"frame", frame_number},
                                        {"dataset", request_.dataset()},
                                        {"duration_ms", duration},
                                        {"status", status}});
    }
    Leave();  // before the client gets its answer: its next request finds the place free
    Finish(rpc::ToGrpcStatus(status));
  }

  // Gives the frame's place to another one.
  void Leave() {
    if (std::exchange(is_counted_, false)) {
      service_->frame_count_.fetch_sub(1);
    }
  }

  // Renders the frame into `image` and fills the response.
  absl::Status Render(std::int64_t frame_number, image::FrameImage* image) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(const DatasetState dataset, service_->options_.registry->FindComplete(
                                                              request_.dataset(), cancellation_));
    dataset_name_ = dataset.dataset.name();
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::GridGeometry geometry,
        rpc::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                              LayoutOf(dataset.dataset, geometry));
    ISOSCOPE_RETURN_IF_ERROR(PlaceCamera(frame_number, dataset, geometry, layout));
    ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                              view::View::Make(*spec_.camera, spec_.viewport, geometry));
    ISOSCOPE_RETURN_IF_ERROR(frame::CheckOwners(spec_.surfaces.size(), layout.block_count()));

    const std::string active_key = ActiveKeyOf(dataset);
    FrameSetup setup;
    setup.spec = &spec_;
    setup.view = &view;
    setup.layout = &layout;
    setup.ties = frame::TieRuleOf(dataset.picture_revision.back_end);
    setup.agent_count = static_cast<int>(dataset.agents.size());
    setup.active = service_->active_blocks_.Find(active_key);
    setup.images = service_->images_.get();
    setup.arena = service_->options_.arena.get();
    internal::BeginFrame begin = MakeBegin(frame_number, dataset);
    begin.set_report_active_blocks(setup.active == nullptr);
    const auto begin_on_agent =
        [&](int agent_index,
            AgentListener* listener) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
      internal::BeginFrame of_agent = begin;
      of_agent.set_agent_index(agent_index);
      return BeginFrameOnAgent(dataset.agents[static_cast<std::size_t>(agent_index)],
                               std::move(of_agent), dataset.dataset.block_count(),
                               cancellation_.deadline(), listener);
    };
    FrameOutcome outcome = RunFrame(setup, begin_on_agent, cancellation_);
    if (!outcome.status.ok()) {
      service_->ReportFailures(frame_number, outcome.failures);
      return outcome.status;
    }
    if (setup.active == nullptr && outcome.result.active != nullptr) {
      service_->active_blocks_.Insert(active_key, outcome.result.active);
    }
    *response_->mutable_statistics() = StatisticsOf(outcome.result);
    *image = std::move(outcome.result.image);
    return Encode(*image);
  }

  // Gives the frame its camera; asks an agent where the surface is, if that decides it.
  absl::Status PlaceCamera(std::int64_t frame_number, const DatasetState& dataset,
                           const volume::GridGeometry& geometry,
                           const volume::BlockLayout& layout) {
    std::optional<math::Box3d> surface_bounds;
    if (request_.camera_fit() == isoscope::v1::CAMERA_FIT_SURFACE) {
      const QueryOutcome<std::optional<math::IndexBox>> outcome =
          AskActiveBox(dataset, layout, frame::IsovaluesOf(spec_), cancellation_);
      service_->ReportFailures(frame_number, outcome.failures);
      ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
      if (outcome.result->has_value()) {
        surface_bounds = view::BoundsOfCells(geometry, **outcome.result);
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(
        rpc::ResolveCamera(geometry.Bounds(), &request_, &spec_, surface_bounds));
    *response_->mutable_camera() = request_.camera();
    return absl::OkStatus();
  }

  [[nodiscard]] std::string ActiveKeyOf(const DatasetState& dataset) const {
    std::vector<std::vector<int>> shard_indices;
    for (const AgentAssignment& agent : dataset.agents) {
      shard_indices.push_back(agent.shard_indices);
    }
    return ActiveBlocksCache::KeyOf(dataset.dataset.dataset_id(), shard_indices,
                                    frame::IsovaluesOf(spec_));
  }

  internal::BeginFrame MakeBegin(std::int64_t frame_number, const DatasetState& dataset) const {
    internal::BeginFrame begin;
    begin.set_frame_number(frame_number);
    begin.set_dataset_id(dataset.dataset.dataset_id());
    *begin.mutable_request() = request_;
    begin.set_agent_count(static_cast<std::int32_t>(dataset.agents.size()));
    return begin;
  }

  absl::Status Encode(const image::FrameImage& image) {
    tbb::task_arena* const arena = service_->options_.arena.get();
    const absl::Time encode_start = absl::Now();
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    response_->set_png(arena->execute([&] {
      return image::EncodePng(image.width, image.height, image.colors, spec_.background_color);
    }));
    isoscope::v1::RenderStatistics* statistics = response_->mutable_statistics();
    statistics->set_png_bytes(static_cast<std::int64_t>(response_->png().size()));
    isoscope::v1::StepDurations* durations = statistics->mutable_durations();
    *durations->mutable_encode_duration() = rpc::ToProto(absl::Now() - encode_start);
    return absl::OkStatus();
  }

  IsosurfaceServiceImpl* const service_;
  isoscope::v1::RenderIsosurfaceRequest request_;           // its camera is resolved by Render
  isoscope::v1::RenderIsosurfaceResponse* const response_;  // gRPC's, until Finish
  const absl::Time start_;
  base::Cancellation cancellation_;
  frame::FrameSpec spec_;
  bool is_counted_ = false;
  std::string dataset_name_;
  std::shared_ptr<RenderCall> self_;  // reset by OnDone
};

// One export. It owns itself as a RenderCall does.
class IsosurfaceServiceImpl::ExportCall final
    : public grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse> {
 public:
  static ExportCall* Start(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
                           const isoscope::v1::ExportIsosurfaceRequest* request) {
    std::shared_ptr<ExportCall> call(new ExportCall(service, context, *request));
    call->self_ = call;
    absl::Status status = rpc::CheckKnownFields(*request);
    if (status.ok()) {
      status = rpc::CheckFinite(request->isovalue(), "isovalue");
    }
    if (!status.ok()) {
      call->outgoing_.Finish(status);
    } else if (!service->export_executor_.TrySchedule([call] { call->Run(); })) {
      call->outgoing_.Finish(absl::ResourceExhaustedError(
          absl::StrCat(kMaxConcurrentExports, " exports are in work and ", kMaxQueuedExports,
                       " wait: retry later, with back-off")));
    }
    return call.get();
  }

  void OnWriteDone(bool ok) override { outgoing_.OnWriteDone(ok); }

  void OnCancel() override {
    cancellation_.Cancel();
    outgoing_.Close();
    {
      const base::MutexLock lock(&streams_mutex_);
      for (SurfaceStream* stream : streams_) {
        stream->Cancel();
      }
    }
    outgoing_.Finish(absl::CancelledError("the client cancelled the export"));
  }

  void OnDone() override { const std::shared_ptr<ExportCall> last_use = std::move(self_); }

 private:
  ExportCall(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
             const isoscope::v1::ExportIsosurfaceRequest& request)
      : service_(service),
        request_(request),
        cancellation_(rpc::DeadlineOf(*context)),
        outgoing_(
            kMaxQueuedExportBytes,
            [this](const isoscope::v1::ExportIsosurfaceResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) { Finish(rpc::ToGrpcStatus(status)); }) {}

  void Run() {
    const absl::Time start = absl::Now();
    const absl::Status status = Export();
    outgoing_.Finish(status);
    base::Log(status.ok() ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              status.ok() ? "export_done" : "export_failed",
              {{"dataset", request_.dataset()},
               {"isovalue", request_.isovalue()},
               {"duration_ms", base::LogMilliseconds(absl::Now() - start)},
               {"bytes", sent_bytes_},
               {"status", status}});
  }

  absl::Status Export() {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(const DatasetState dataset, service_->options_.registry->FindComplete(
                                                              request_.dataset(), cancellation_));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::GridGeometry geometry,
        rpc::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                              LayoutOf(dataset.dataset, geometry));

    std::vector<std::unique_ptr<SurfaceStream>> streams;
    std::vector<SurfaceSource*> sources;
    for (const AgentAssignment& agent : dataset.agents) {
      streams.push_back(std::make_unique<SurfaceStream>(agent, dataset.dataset.dataset_id(), layout,
                                                        request_.isovalue(),
                                                        cancellation_.deadline()));
      sources.push_back(streams.back().get());
    }
    ShareStreams(streams);
    absl::Status status = ExportSurface(
        geometry, layout, sources, [this](SurfaceChunk chunk) { return Send(std::move(chunk)); });
    ShareStreams({});
    std::vector<AgentFailure> failures;
    for (std::size_t i = 0; i < streams.size(); ++i) {
      if (!streams[i]->status().ok()) {
        failures.push_back({.agent_index = i,
                            .agent = streams[i]->agent(),
                            .stage = FrameStage::kRenderingVisible,
                            .status = streams[i]->status()});
      }
    }
    service_->ReportFailures(/*frame_number=*/0, failures);
    return status;
  }

  // Lets OnCancel reach the streams while they live.
  void ShareStreams(const std::vector<std::unique_ptr<SurfaceStream>>& streams) {
    const base::MutexLock lock(&streams_mutex_);
    streams_.clear();
    for (const std::unique_ptr<SurfaceStream>& stream : streams) {
      streams_.push_back(stream.get());
      if (cancellation_.is_cancelled()) {
        stream->Cancel();
      }
    }
  }

  absl::Status Send(SurfaceChunk chunk) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    sent_bytes_ += chunk.size_bytes();
    isoscope::v1::ExportIsosurfaceResponse message;
    message.set_positions(std::move(chunk.positions));
    message.set_normals(std::move(chunk.normals));
    message.set_triangles(std::move(chunk.triangles));
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  IsosurfaceServiceImpl* const service_;
  const isoscope::v1::ExportIsosurfaceRequest request_;
  base::Cancellation cancellation_;
  rpc::WriteQueue<isoscope::v1::ExportIsosurfaceResponse> outgoing_;
  std::size_t sent_bytes_ = 0;
  base::Mutex streams_mutex_;
  std::vector<SurfaceStream*> streams_ ABSL_GUARDED_BY(streams_mutex_);
  std::shared_ptr<ExportCall> self_;  // reset by OnDone
};

IsosurfaceServiceImpl::IsosurfaceServiceImpl(const IsosurfaceServiceOptions& options)
    : options_(options),
      active_blocks_(kMaxActiveBlocksBytes),
      images_(image::FrameImagePool::Make(kMaxUnusedImageBytes)),
      frame_executor_(
          static_cast<std::size_t>(options.max_concurrent_frames),
          // frame_count_ bounds the frames, so each of them fits.
          static_cast<std::size_t>(options.max_concurrent_frames + options.max_queued_frames)),
      export_executor_(kMaxConcurrentExports, kMaxQueuedExports) {
  if (options.expected_viewport) {
    // Two, because one may still be cleared when the next frame begins.
    for (int i = 0; i < 2; ++i) {
      images_->Prepare(options.expected_viewport->width_px, options.expected_viewport->height_px);
    }
  }
}

IsosurfaceServiceImpl::~IsosurfaceServiceImpl() = default;

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::RenderIsosurface(
    grpc::CallbackServerContext* context, const isoscope::v1::RenderIsosurfaceRequest* request,
    isoscope::v1::RenderIsosurfaceResponse* response) {
  return RenderCall::Start(this, context, request, response);
}

grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>*
IsosurfaceServiceImpl::ExportIsosurface(grpc::CallbackServerContext* context,
                                        const isoscope::v1::ExportIsosurfaceRequest* request) {
  return ExportCall::Start(this, context, request);
}

void IsosurfaceServiceImpl::ReportFailures(std::int64_t frame_number,
                                           const std::vector<AgentFailure>& failures) const {
  for (const AgentFailure& failure : failures) {
    base::LogWarning("agent_failed", {{"frame", frame_number},
                                      {"agent", failure.agent.address},
                                      {"shards", absl::StrJoin(failure.agent.shard_indices, ",")},
                                      {"stage", NameOf(failure.stage)},
                                      {"status", failure.status}});
    if (absl::IsUnavailable(failure.status) || absl::IsFailedPrecondition(failure.status)) {
      options_.registry->ReportFailure(failure.agent.address);
    }
  }
}

}  // namespace isoscope::server
