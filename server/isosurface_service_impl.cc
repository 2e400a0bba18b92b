// A frame (FrameCall):
//
// 1. Admit, on gRPC's thread, converts the request. An error that no state of the cluster could
//    change is answered at once. Then the frame is counted, refused if too many are in work or wait
//    or if it can never fit the memory limit, and queued.
// 2. On a frame thread it waits for its memory, then FrameRunner finds the dataset, which may wait
//    for a probe of the agents, and makes camera, view and layout.
// 3. RunFrame does the work with the agents (frame_coordinator). If the cache knows which blocks
//    are active, agents need not report them; otherwise their report goes into the cache.
// 4. Picture and planes are encoded, in the arena. The frame gives its place to another one before
//    the client gets the answer, so that the client's next request finds it free. Its memory is
//    given back when gRPC is done with the response.
//
// Normals travel in place of colours. A frame with a picture and normals is drawn twice.
//
// A pick is a frame of the smallest region that holds its pixels. Each shard counts as an agent of
// its own, so that the block of a pixel tells its shard.
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
#include <functional>
#include <memory>
#include <optional>
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
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/pick_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/response_splitter.h"
#include "core/rpc/write_queue.h"
#include "core/view/camera.h"
#include "core/view/view.h"
#include "server/agent_client.h"
#include "server/frame_output.h"
#include "server/frame_runner.h"
#include "server/render_statistics.h"
#include "server/surface_export.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// If this many bytes of chunks wait for a slow client, the merge waits too.
constexpr std::size_t kMaxQueuedExportBytes = 4 * base::kMiB;
// The room in a message for what is neither picture nor plane.
constexpr std::size_t kOtherFieldsBytes = base::kMiB;

// Returns when a frame that began at `start` must end so that its client still hears which agent is
// late. A client whose own clock runs out first learns nothing.
absl::Time AnswerBefore(absl::Time client_deadline, absl::Time start) {
  constexpr absl::Duration kMaxMargin = absl::Milliseconds(200);  // an answer on a slow network
  constexpr int kMarginShare = 10;                                // of the client's time
  const absl::Duration margin = std::min((client_deadline - start) / kMarginShare, kMaxMargin);
  return client_deadline - std::max(margin, absl::ZeroDuration());
}

}  // namespace

// The part of a call that has nothing to do with how its answer is sent: one frame, from the
// request to the response. The reactor of the call owns it. The thread that renders shares it.
class IsosurfaceServiceImpl::FrameCall {
 public:
  FrameCall(IsosurfaceServiceImpl* service, const grpc::CallbackServerContext& context,
            const v1::RenderIsosurfaceRequest& request, Delivery delivery)
      : runner_(service->runner_.get()),
        request_(request),
        delivery_(delivery),
        start_(absl::Now()),
        cancellation_(std::min(AnswerBefore(rpc::DeadlineOf(context), start_),
                               start_ + service->options_.max_frame_duration)) {}

  // Takes a place for the frame. A request that can't be right in any state of the cluster does not
  // wait.
  absl::Status Admit() {
    ISOSCOPE_ASSIGN_OR_RETURN(spec_, rpc::FrameSpecFromProto(request_));
    return TakePlace();
  }
  // The same for a pick, of which `pixels` are the pixels.
  absl::Status AdmitPick(const v1::PickSurfaceRequest& pick) {
    ISOSCOPE_ASSIGN_OR_RETURN(rpc::PickSpec converted, rpc::PickSpecFromProto(pick));
    pixels_ = std::move(converted.pixels);
    request_ = std::move(converted.request);
    spec_ = std::move(converted.frame);
    return TakePlace();
  }

  void Cancel() { cancellation_.Cancel(); }
  // Clears the image for its pool, once the client has its answer.
  void ReleaseImage() { image_ = image::FrameImage(); }
  void Schedule(std::function<void()> work) { runner_->Schedule(std::move(work)); }

  // Renders the frame into `response`.
  absl::Status Render(v1::RenderIsosurfaceResponse* response) {
    const std::int64_t frame_number = runner_->NextFrameNumber();
    const absl::Status status = TryRender(frame_number, response);
    Log(frame_number, status, response->statistics());
    place_.reset();  // before the client gets its answer: its next request finds the place free
    return status;
  }

  absl::Status Pick(v1::PickSurfaceResponse* response) {
    const std::int64_t frame_number = runner_->NextFrameNumber();
    const absl::Status status = TryPick(frame_number, response);
    Log(frame_number, status, response->statistics());
    place_.reset();
    return status;
  }

 private:
  absl::Status TakePlace() {
    if (delivery_ == Delivery::kWhole) {
      ISOSCOPE_RETURN_IF_ERROR(CheckMessageBytes(RawResponseBytes()));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(FrameRunner::Place place, runner_->Admit(spec_, delivery_));
    place_.emplace(std::move(place));
    return absl::OkStatus();
  }

  [[nodiscard]] std::size_t RawResponseBytes() const {
    const view::Viewport size = frame::ImageSizeOf(spec_);
    return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px) *
           frame::RawBytesPerPixel(spec_.output);
  }

  static absl::Status CheckMessageBytes(std::size_t bytes) {
    if (bytes + kOtherFieldsBytes <= static_cast<std::size_t>(rpc::kMaxMessageBytes)) {
      return absl::OkStatus();
    }
    return absl::InvalidArgumentError(absl::StrCat(
        "output: picture and planes have ", bytes, " bytes and one message holds at most ",
        rpc::kMaxMessageBytes, ": ask RenderIsosurfaceStream, or for a region or fewer planes"));
  }

  absl::Status Reserve() {
    ISOSCOPE_ASSIGN_OR_RETURN(base::MemoryBudget::Reservation memory,
                              runner_->ReserveMemory(spec_, delivery_, cancellation_));
    memory_.emplace(std::move(memory));
    return absl::OkStatus();
  }

  absl::Status TryRender(std::int64_t frame_number, v1::RenderIsosurfaceResponse* response) {
    ISOSCOPE_RETURN_IF_ERROR(Reserve());
    ISOSCOPE_ASSIGN_OR_RETURN(const FrameTarget target,
                              runner_->FindTarget(&request_, &spec_, false, cancellation_));
    dataset_name_ = target.dataset.dataset.name();
    *response->mutable_camera() = request_.camera();
    *response->mutable_extent() = rpc::ToProto(target.view.image_size());

    // A frame whose pixels are not colours has the same depths and surfaces.
    frame::FrameSpec drawn = spec_;
    drawn.sends_normals =
        spec_.output.normal && spec_.output.image_format == frame::ImageFormat::kNone;
    ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result,
                              runner_->Run(frame_number, request_, drawn, target, cancellation_));
    *response->mutable_statistics() = StatisticsOf(result);
    image_ = std::move(result.image);
    FrameOutput output;
    ISOSCOPE_RETURN_IF_ERROR(Encode(target, drawn.sends_normals, &output, response));
    if (spec_.output.normal && !drawn.sends_normals) {
      image_ = image::FrameImage();
      drawn.sends_normals = true;
      ISOSCOPE_ASSIGN_OR_RETURN(result,
                                runner_->Run(frame_number, request_, drawn, target, cancellation_));
      image_ = std::move(result.image);
      output.normal = runner_->arena()->execute([&] { return NormalPlane(image_); });
    }
    if (delivery_ == Delivery::kWhole) {
      ISOSCOPE_RETURN_IF_ERROR(CheckMessageBytes(output.size_bytes()));
    }
    MoveInto(std::move(output), response);
    return absl::OkStatus();
  }

  absl::Status Encode(const FrameTarget& target, bool carries_normals, FrameOutput* output,
                      v1::RenderIsosurfaceResponse* response) {
    const absl::Time encode_start = absl::Now();
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_RETURN_IF_ERROR(runner_->arena()->execute([&]() -> absl::Status {
      if (carries_normals) {
        output->normal = NormalPlane(image_);
      } else {
        ISOSCOPE_ASSIGN_OR_RETURN(output->image, EncodePicture(image_, spec_));
      }
      FillPlanes(image_, spec_, target.view, target.order, output);
      return absl::OkStatus();
    }));
    v1::RenderStatistics* statistics = response->mutable_statistics();
    if (spec_.output.image_format == frame::ImageFormat::kPng) {
      statistics->set_png_bytes(static_cast<std::int64_t>(output->image.size()));
    }
    *statistics->mutable_durations()->mutable_encode_duration() =
        rpc::ToProto(absl::Now() - encode_start);
    return absl::OkStatus();
  }

  void MoveInto(FrameOutput output, v1::RenderIsosurfaceResponse* response) const {
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

  absl::Status TryPick(std::int64_t frame_number, v1::PickSurfaceResponse* response) {
    ISOSCOPE_RETURN_IF_ERROR(Reserve());
    ISOSCOPE_ASSIGN_OR_RETURN(
        const FrameTarget target,
        runner_->FindTarget(&request_, &spec_, /*is_each_shard_apart=*/true, cancellation_));
    dataset_name_ = target.dataset.dataset.name();
    *response->mutable_camera() = request_.camera();
    spec_.sends_normals = target.dataset.picture_revision.back_end == frame::BackEnd::kCpu;
    ISOSCOPE_ASSIGN_OR_RETURN(FrameResult result,
                              runner_->Run(frame_number, request_, spec_, target, cancellation_));
    *response->mutable_statistics() = StatisticsOf(result);
    image_ = std::move(result.image);
    for (const rpc::PixelPosition& pixel : pixels_) {
      v1::PickedPoint* out = response->add_points();
      const std::optional<PixelPoint> point =
          PointAt(image_, pixel.x - spec_.region->x, pixel.y - spec_.region->y, target.view,
                  target.order, spec_.sends_normals);
      if (!point.has_value()) {
        continue;
      }
      out->set_is_hit(true);
      *out->mutable_position() = rpc::ToProto(point->position);
      out->set_depth(point->distance);
      out->set_surface_index(static_cast<std::int32_t>(point->surface_index));
      if (point->normal.has_value()) {
        *out->mutable_normal() = rpc::ToProto(*point->normal);
      }
      out->set_block_id(point->block_id);
      const std::optional<std::size_t> agent = AgentOf(point->block_id, *result.active);
      if (!agent.has_value()) {
        return absl::InternalError(absl::StrCat("pixel ", pixel.x, ", ", pixel.y, " shows block ",
                                                point->block_id, ", which no agent has"));
      }
      const std::vector<int>& shards = target.dataset.agents[*agent].shard_indices;
      if (shards.size() == 1) {
        out->set_shard_index(shards.front());
      }
    }
    return absl::OkStatus();
  }

  // Returns the index of the agent that has an active block; none if no agent has it.
  static std::optional<std::size_t> AgentOf(volume::BlockId block, const ActiveBlocks& active) {
    for (std::size_t agent = 0; agent + 1 < active.begin_by_agent.size(); ++agent) {
      const auto begin =
          active.ids.begin() + static_cast<std::ptrdiff_t>(active.begin_by_agent[agent]);
      const auto end =
          active.ids.begin() + static_cast<std::ptrdiff_t>(active.begin_by_agent[agent + 1]);
      if (std::binary_search(begin, end, block)) {
        return agent;
      }
    }
    return std::nullopt;
  }

  void Log(std::int64_t frame_number, const absl::Status& status,
           const v1::RenderStatistics& statistics) const {
    const std::string duration = base::LogMilliseconds(absl::Now() - start_);
    if (status.ok()) {
      base::LogInfo(pixels_.empty() ? "frame_done" : "pick_done",
                    {{"frame", frame_number},
                     {"dataset", dataset_name_},
                     {"isovalues", absl::StrJoin(frame::IsovaluesOf(spec_), ",")},
                     {"width", frame::ImageSizeOf(spec_).width_px},
                     {"height", frame::ImageSizeOf(spec_).height_px},
                     {"duration_ms", duration},
                     {"triangles", statistics.triangle_count()},
                     {"agents", statistics.agents_size()},
                     {"network_bytes", statistics.network_bytes()}});
    } else {
      base::LogWarning(pixels_.empty() ? "frame_failed" : "pick_failed",
                       {{"frame", frame_number},
                        {"dataset", request_.dataset()},
                        {"duration_ms", duration},
                        {"status", status}});
    }
  }

  FrameRunner* const runner_;
  v1::RenderIsosurfaceRequest request_;  // FindTarget resolves its camera
  const Delivery delivery_;
  const absl::Time start_;
  base::Cancellation cancellation_;
  frame::FrameSpec spec_;
  std::vector<rpc::PixelPosition> pixels_;  // of a pick
  std::optional<FrameRunner::Place> place_;
  std::string dataset_name_;
  image::FrameImage image_;
  // Given back when gRPC is done with the response.
  std::optional<base::MemoryBudget::Reservation> memory_;
};

// A call with one request and one response. It owns itself until gRPC is done with it.
template <typename Response>
class IsosurfaceServiceImpl::UnaryCall final : public grpc::ServerUnaryReactor {
 public:
  using Work = absl::Status (FrameCall::*)(Response* response);

  // Runs `work` on a frame thread if `admitted` is OK.
  static UnaryCall* Start(std::unique_ptr<FrameCall> frame, const absl::Status& admitted, Work work,
                          Response* response) {
    std::shared_ptr<UnaryCall> call(new UnaryCall(std::move(frame)));
    call->self_ = call;
    if (!admitted.ok()) {
      call->Finish(rpc::ToGrpcStatus(admitted));
      return call.get();
    }
    call->frame_->Schedule([call, work, response] {
      call->Finish(rpc::ToGrpcStatus((call->frame_.get()->*work)(response)));
      call->frame_->ReleaseImage();
    });
    return call.get();
  }

  void OnCancel() override { frame_->Cancel(); }
  void OnDone() override { const std::shared_ptr<UnaryCall> last_use = std::move(self_); }

 private:
  explicit UnaryCall(std::unique_ptr<FrameCall> frame) : frame_(std::move(frame)) {}

  const std::unique_ptr<FrameCall> frame_;
  std::shared_ptr<UnaryCall> self_;  // reset by OnDone
};

// A frame whose response goes out in parts. It is complete before the first part is sent, so no
// thread waits for a slow client.
class IsosurfaceServiceImpl::StreamCall final
    : public grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse> {
 public:
  static StreamCall* Start(std::unique_ptr<FrameCall> frame, const absl::Status& admitted) {
    std::shared_ptr<StreamCall> call(new StreamCall(std::move(frame)));
    call->self_ = call;
    if (!admitted.ok()) {
      call->Finish(rpc::ToGrpcStatus(admitted));
      return call.get();
    }
    call->frame_->Schedule([call] { call->Run(); });
    return call.get();
  }

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      Finish(rpc::ToGrpcStatus(absl::CancelledError("the client cancelled the frame")));
    }
  }
  void OnCancel() override { frame_->Cancel(); }
  void OnDone() override { const std::shared_ptr<StreamCall> last_use = std::move(self_); }

 private:
  explicit StreamCall(std::unique_ptr<FrameCall> frame) : frame_(std::move(frame)) {}

  void Run() {
    v1::RenderIsosurfaceResponse response;
    const absl::Status status = frame_->Render(&response);
    if (!status.ok()) {
      Finish(rpc::ToGrpcStatus(status));
      return;
    }
    splitter_.emplace(std::move(response));
    WriteNext();
    frame_->ReleaseImage();
  }

  void WriteNext() {
    message_.Clear();
    if (!splitter_->Next(message_.mutable_part())) {
      Finish(grpc::Status::OK);
      return;
    }
    StartWrite(&message_);
  }

  const std::unique_ptr<FrameCall> frame_;
  std::optional<rpc::ResponseSplitter> splitter_;
  v1::RenderIsosurfaceStreamResponse message_;
  std::shared_ptr<StreamCall> self_;  // reset by OnDone
};

// One export. It owns itself as a UnaryCall does.
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
    service_->runner_->ReportFailures(/*frame_number=*/0, failures);
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
      runner_(std::make_unique<FrameRunner>(
          FrameRunnerOptions{.registry = options.registry,
                             .max_concurrent_frames = options.max_concurrent_frames,
                             .max_queued_frames = options.max_queued_frames,
                             .arena = options.arena,
                             .memory_limit_bytes = options.memory_limit_bytes,
                             .expected_viewport = options.expected_viewport})),
      export_executor_(kMaxConcurrentExports, kMaxQueuedExports) {
  rpc::PrepareKnownFields(isoscope::v1::RenderIsosurfaceRequest());
}

IsosurfaceServiceImpl::~IsosurfaceServiceImpl() = default;

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::RenderIsosurface(
    grpc::CallbackServerContext* context, const v1::RenderIsosurfaceRequest* request,
    v1::RenderIsosurfaceResponse* response) {
  auto frame = std::make_unique<FrameCall>(this, *context, *request, Delivery::kWhole);
  const absl::Status admitted = frame->Admit();
  return UnaryCall<v1::RenderIsosurfaceResponse>::Start(std::move(frame), admitted,
                                                        &FrameCall::Render, response);
}

grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse>*
IsosurfaceServiceImpl::RenderIsosurfaceStream(grpc::CallbackServerContext* context,
                                              const v1::RenderIsosurfaceStreamRequest* request) {
  auto frame = std::make_unique<FrameCall>(this, *context, request->request(), Delivery::kParts);
  absl::Status admitted = rpc::CheckKnownFields(*request);
  if (admitted.ok()) {
    admitted = frame->Admit();
  }
  return StreamCall::Start(std::move(frame), admitted);
}

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::PickSurface(grpc::CallbackServerContext* context,
                                                             const v1::PickSurfaceRequest* request,
                                                             v1::PickSurfaceResponse* response) {
  auto frame = std::make_unique<FrameCall>(this, *context, request->frame(), Delivery::kWhole);
  const absl::Status admitted = frame->AdmitPick(*request);
  return UnaryCall<v1::PickSurfaceResponse>::Start(std::move(frame), admitted, &FrameCall::Pick,
                                                   response);
}

grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>*
IsosurfaceServiceImpl::ExportIsosurface(grpc::CallbackServerContext* context,
                                        const isoscope::v1::ExportIsosurfaceRequest* request) {
  return ExportCall::Start(this, context, request);
}

}  // namespace isoscope::server
