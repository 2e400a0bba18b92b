// A frame or a pick is a FrameCall, which a reactor owns: UnaryCall for one response, StreamCall
// for one in parts.
//
// An export (ExportCall) opens a stream to each agent, for one surface after the other, and lets
// ExportSurface merge them, on an export thread. Its chunks wait in outgoing_. When 4 MiB wait for
// a slow client, the merge waits, and gRPC's flow control then stops the agents. OnCancel cancels
// the streams, which wakes the merge.
//
// EndEarly does so, too, and lets the client hear why: an alarm calls it for a client that is too
// slow (export_pace), or the watch of a token that is withdrawn.

#include "server/isosurface_service_impl.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include <grpcpp/alarm.h>

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/peer.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/request_context.h"
#include "core/rpc/response_splitter.h"
#include "core/rpc/write_queue.h"
#include "core/rpc/write_timeout.h"
#include "server/admission/coordinator_memory.h"
#include "server/export/surface_export.h"
#include "server/frame/agent_client.h"
#include "server/frame/frame_call.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// If this many bytes of chunks wait for a slow client, the merge waits too.
constexpr std::size_t kMaxQueuedExportBytes = 2 * base::kMiB;

// In which a client must take a part of an answer, or a chunk of a mesh. A whole answer may take as
// long as a frame.
constexpr absl::Duration kMaxWriteDuration = absl::Minutes(1);
// In which a client whose token was withdrawn must take what is on its way.
constexpr absl::Duration kMaxLastWriteDuration = absl::Seconds(2);

void CountRequest(RequestMethod method, const absl::Status& status, const FrameCall& frame) {
  frame.runner()->EndRequest(method, frame.audit_record(), frame.identity(), status,
                             absl::Now() - frame.start());
}

}  // namespace

// A call with one request and one response. It owns itself until gRPC is done with it.
template <typename Response>
class IsosurfaceServiceImpl::UnaryCall final : public grpc::ServerUnaryReactor {
 public:
  using Work = absl::Status (FrameCall::*)(Response* response);

  // Runs `work` on a frame thread if `admitted` is OK.
  static UnaryCall* Start(RequestMethod method, grpc::CallbackServerContext* context,
                          absl::Duration max_write_duration, std::unique_ptr<FrameCall> frame,
                          const absl::Status& admitted, Work work, Response* response) {
    std::shared_ptr<UnaryCall> call(new UnaryCall(method, context, std::move(frame)));
    call->self_ = call;
    if (!admitted.ok()) {
      call->End(admitted);
      return call.get();
    }
    call->frame_->Schedule([call, work, response, max_write_duration] {
      const absl::Status status = (call->frame_.get()->*work)(response);
      const std::size_t answer_bytes = status.ok() ? response->ByteSizeLong() : 0;
      call->unsent_.Set(static_cast<std::int64_t>(answer_bytes));
      call->timeout_.Start(max_write_duration);
      call->End(status);
      call->frame_->ReleaseImages();
      call->frame_->KeepMemoryOfAnswer(answer_bytes);
    });
    return call.get();
  }

  void OnCancel() override { frame_->Cancel(); }
  void OnDone() override {
    timeout_.Stop();
    const std::shared_ptr<UnaryCall> last_use = std::move(self_);
  }

 private:
  UnaryCall(RequestMethod method, grpc::CallbackServerContext* context,
            std::unique_ptr<FrameCall> frame)
      : method_(method),
        frame_(std::move(frame)),
        unsent_(&frame_->runner()->metrics()->unsent_bytes),
        timeout_(context) {}

  void End(const absl::Status& status) {
    CountRequest(method_, status, *frame_);
    Finish(rpc::ToGrpcStatus(status));
  }

  const RequestMethod method_;
  const std::unique_ptr<FrameCall> frame_;
  base::GaugeShare unsent_;  // until OnDone
  rpc::WriteTimeout timeout_;
  std::shared_ptr<UnaryCall> self_;  // reset by OnDone
};

// A frame whose response goes out in parts. It is complete before the first part is sent, so no
// thread waits for a slow client.
class IsosurfaceServiceImpl::StreamCall final
    : public grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse> {
 public:
  static StreamCall* Start(grpc::CallbackServerContext* context, std::unique_ptr<FrameCall> frame,
                           const absl::Status& admitted) {
    std::shared_ptr<StreamCall> call(new StreamCall(context, std::move(frame)));
    call->self_ = call;
    if (!admitted.ok()) {
      call->End(admitted);
      return call.get();
    }
    call->frame_->Schedule([call] { call->Run(); });
    return call.get();
  }

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      End(absl::CancelledError("the client cancelled the frame"));
    }
  }
  void OnCancel() override { frame_->Cancel(); }
  void OnDone() override {
    timeout_.Stop();
    const std::shared_ptr<StreamCall> last_use = std::move(self_);
  }

 private:
  StreamCall(grpc::CallbackServerContext* context, std::unique_ptr<FrameCall> frame)
      : frame_(std::move(frame)),
        unsent_(&frame_->runner()->metrics()->unsent_bytes),
        timeout_(context) {}

  void Run() {
    v1::RenderIsosurfaceResponse response;
    const absl::Status status = frame_->Render(&response);
    if (!status.ok()) {
      End(status);
      return;
    }
    const std::size_t answer_bytes = response.ByteSizeLong();
    unsent_.Set(static_cast<std::int64_t>(answer_bytes));
    splitter_.emplace(std::move(response));
    WriteNext();
    frame_->ReleaseImages();
    frame_->KeepMemoryOfAnswer(answer_bytes);
  }

  void WriteNext() {
    message_.Clear();
    if (!splitter_->Next(message_.mutable_part())) {
      End(absl::OkStatus());
      return;
    }
    timeout_.Start(kMaxWriteDuration);
    StartWrite(&message_);
  }

  void End(const absl::Status& status) {
    CountRequest(RequestMethod::kRenderIsosurfaceStream, status, *frame_);
    Finish(rpc::ToGrpcStatus(status));
  }

  const std::unique_ptr<FrameCall> frame_;
  base::GaugeShare unsent_;  // until OnDone
  rpc::WriteTimeout timeout_;
  std::optional<rpc::ResponseSplitter> splitter_;
  v1::RenderIsosurfaceStreamResponse message_;
  std::shared_ptr<StreamCall> self_;  // reset by OnDone
};

// One export. It owns itself as a UnaryCall does.
class IsosurfaceServiceImpl::ExportCall final
    : public grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>,
      public std::enable_shared_from_this<ExportCall> {
 public:
  static ExportCall* Start(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
                           const isoscope::v1::ExportIsosurfaceRequest* request) {
    std::shared_ptr<ExportCall> call(new ExportCall(service, context, *request));
    call->self_ = call;
    const absl::Status admitted = call->Admit(*context);
    if (!admitted.ok()) {
      call->outgoing_.Finish(admitted);
      return call.get();
    }
    call->watch_.emplace(call->caller_.WhenWithdrawn([weak = call->weak_from_this()] {
      if (const std::shared_ptr<ExportCall> self = weak.lock()) {
        const base::MutexLock lock(&self->early_end_mutex_);
        self->EndEarly(CutReason::kTokenWithdrawn, WithdrawnError());
        self->timeout_.Start(kMaxLastWriteDuration);
      }
    }));
    service->exports_.Schedule(call->place_->ticket(), call->cancellation_.deadline(),
                               [call](const absl::Status& turn) { call->Run(turn); });
    return call.get();
  }

  void OnWriteDone(bool ok) override {
    timeout_.Pause();
    {
      const base::MutexLock lock(&pace_mutex_);
      if (pace_.has_value()) {
        pace_->OnWriteDone(in_flight_bytes_, absl::Now());
      }
    }
    unsent_.Add(-in_flight_unsent_bytes_.exchange(0));
    outgoing_.OnWriteDone(ok);
  }

  void OnCancel() override {
    outgoing_.Close();
    StopWork();
    outgoing_.Finish(absl::CancelledError("the client cancelled the export"));
  }

  void OnDone() override {
    timeout_.Stop();
    const std::shared_ptr<ExportCall> last_use = std::move(self_);
    const base::MutexLock early_end_lock(&early_end_mutex_);  // the service may go after this
    const base::MutexLock lock(&pace_mutex_);
    alarm_.reset();
    is_done_ = true;
  }

 private:
  ExportCall(IsosurfaceServiceImpl* service, grpc::CallbackServerContext* context,
             const isoscope::v1::ExportIsosurfaceRequest& request)
      : service_(service),
        request_(request),
        identity_(rpc::AnswerTraceContext(context)),
        cancellation_(rpc::DeadlineOf(*context)),
        unsent_(&service->options_.runner->metrics()->unsent_bytes),
        timeout_(context),
        outgoing_(
            kMaxQueuedExportBytes,
            [this](const isoscope::v1::ExportIsosurfaceResponse* message) {
              timeout_.Start(kMaxWriteDuration);
              in_flight_unsent_bytes_ = BytesOf(*message);
              BeginPace(message->ByteSizeLong());
              StartWrite(message);
            },
            [this](const absl::Status& status) {
              slot_.reset();  // before the client hears of the end, and asks for another
              service_->options_.runner->EndRequest(RequestMethod::kExportIsosurface,
                                                    audit_record(), identity_, status,
                                                    absl::Now() - arrival_);
              Finish(rpc::ToGrpcStatus(status));
            }) {
    const base::MutexLock lock(&audit_mutex_);
    audit_ = RecordOf(rpc::PeerOf(*context), context->peer());
    audit_.dataset = request.dataset();
  }

  // OnCancel may end the call while the export finds its dataset.
  [[nodiscard]] AuditRecord audit_record() ABSL_LOCKS_EXCLUDED(audit_mutex_) {
    const base::MutexLock lock(&audit_mutex_);
    return audit_;
  }

  absl::Status Admit(const grpc::CallbackServerContext& context) {
    ISOSCOPE_ASSIGN_OR_RETURN(caller_, service_->options_.access->Identify(rpc::PeerOf(context)));
    {
      const base::MutexLock lock(&audit_mutex_);
      audit_.caller = caller_.name();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(spec_, rpc::ExportSpecFromProto(request_));
    // First what the caller may: above it, it must not take a place that another could have.
    CoordinatorMetrics* const metrics = service_->options_.runner->metrics();
    ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kBytes, caller_.CheckBytes()));
    absl::StatusOr<CallerSlot> slot = caller_.Begin(CallerUse::kExport);
    ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kExports, slot.status()));
    ISOSCOPE_RETURN_IF_ERROR(
        metrics->CountRefusal(TokenLimit::kFrameRate, caller_.TakeFrame(/*is_moving=*/false)));
    absl::StatusOr<Admission::Place> place =
        service_->exports_.Admit(caller_.QueueKey(context.peer()));
    if (!place.ok()) {
      caller_.ReturnFrame();
      return place.status();
    }
    slot_.emplace(*std::move(slot));
    ticket_ = place->ticket();
    place_.emplace(*std::move(place));
    return absl::OkStatus();
  }

  // Lets all that works for the export stop.
  void StopWork() {
    cancellation_.Cancel();
    service_->exports_.Leave(ticket_);
    const base::MutexLock lock(&streams_mutex_);
    for (SurfaceStream* stream : streams_) {
      stream->Cancel();
    }
  }

  // Ends the export after the chunk that is on its way, and says why.
  void EndEarly(CutReason reason, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(early_end_mutex_) {
    {
      const base::MutexLock lock(&pace_mutex_);
      if (is_done_ || !end_.ok()) {
        return;
      }
      end_ = status;
    }
    service_->options_.runner->metrics()->CountCut(reason);
    outgoing_.Finish(status);  // first: what stops would say less
    StopWork();
  }

  // Watches the pace from now on.
  void StartPace() {
    const base::MutexLock lock(&pace_mutex_);
    pace_.emplace(service_->options_.export_limits, absl::Now());
    SetAlarm();
  }
  void BeginPace(std::size_t bytes) {
    const base::MutexLock lock(&pace_mutex_);
    in_flight_bytes_ = bytes;
    if (pace_.has_value()) {
      pace_->OnWriteBegun(absl::Now());
    }
  }
  void SetAlarm() ABSL_EXCLUSIVE_LOCKS_REQUIRED(pace_mutex_) {
    if (is_done_) {
      return;
    }
    alarm_ = std::make_unique<grpc::Alarm>();
    alarm_->Set(absl::ToChronoTime(pace_->NextJudgement(absl::Now())),
                [self = shared_from_this()](bool rang) {
                  if (rang) {
                    self->JudgePace();
                  }
                });
  }
  void JudgePace() {
    const base::MutexLock early_end_lock(&early_end_mutex_);
    ExportPace::Verdict verdict;
    {
      const base::MutexLock lock(&pace_mutex_);
      if (is_done_) {
        return;
      }
      verdict = pace_->Judge(absl::Now());
      if (verdict == ExportPace::Verdict::kGoesOn) {
        SetAlarm();
        return;
      }
    }
    const ExportLimits& limits = service_->options_.export_limits;
    const std::string so_far =
        absl::StrCat("the export ended after ", sent_bytes_.load(), " bytes: ");
    if (verdict == ExportPace::Verdict::kTooSlow) {
      EndEarly(CutReason::kTooSlow,
               absl::DeadlineExceededError(absl::StrCat(
                   so_far, "its client took less than ", limits.least_bytes_per_second,
                   " bytes a second: read chunks as they come, or ask for a clip region")));
    } else {
      EndEarly(CutReason::kTooLong,
               absl::DeadlineExceededError(absl::StrCat(
                   so_far, "it took ", absl::FormatDuration(limits.max_duration),
                   ", the most that one may: ask for a clip region, or raise the coordinator's "
                   "--max-export-seconds")));
    }
  }

  // Gets the reason if the turn of the export did not come.
  void Run(const absl::Status& turn) {
    const absl::Time start = absl::Now();
    if (turn.ok()) {
      StartPace();
    } else if (absl::IsResourceExhausted(turn)) {
      caller_.ReturnFrame();  // it made room for another
    }
    absl::Status status = turn.ok() ? Export() : turn;
    {
      const base::MutexLock lock(&pace_mutex_);
      if (!end_.ok()) {
        status = end_;
      }
    }
    if (memory_.has_value()) {
      memory_->ShrinkTo(CoordinatorMemory::kExportAnswerBytes);
    }
    place_.reset();
    outgoing_.Finish(status);
    base::Log(status.ok() ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              status.ok() ? "export_done" : "export_failed",
              {{"request", identity_.request_id()},
               {"dataset", request_.dataset()},
               {"isovalues", absl::StrJoin(spec_.isovalues, ",")},
               {"duration_ms", base::LogMilliseconds(absl::Now() - start)},
               {"bytes", sent_bytes_.load()},
               {"caller", caller_.name()},
               {"peer", audit_record().peer},
               {"status", status}});
  }

  absl::Status Export() {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::shared_ptr<const DatasetState> found,
        service_->options_.registry->FindComplete(request_.dataset(), cancellation_, caller_));
    const DatasetState& dataset = *found;
    {
      const base::MutexLock lock(&audit_mutex_);
      audit_.dataset = dataset.dataset.name();
      audit_.dataset_id = dataset.dataset.dataset_id();
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(dataset.dataset, request_.dataset_id()));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::GridGeometry geometry,
        rpc::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                              LayoutOf(dataset.dataset, geometry));

    FrameRunner* const runner = service_->options_.runner;
    ISOSCOPE_ASSIGN_OR_RETURN(
        base::MemoryBudget::Reservation memory,
        runner->ReserveExportMemory(runner->PartsOf(dataset).size(), cancellation_));
    memory_.emplace(std::move(memory));
    const ExportedVolume volume{.geometry = geometry, .layout = layout, .clip = spec_.clip};
    std::int64_t vertex_count = 0;
    for (std::size_t i = 0; i < spec_.isovalues.size(); ++i) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t added,
                                ExportOne(dataset, volume, i, vertex_count));
      vertex_count += added;
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::int64_t> ExportOne(const DatasetState& dataset, const ExportedVolume& volume,
                                         std::size_t surface_index, std::int64_t first_vertex) {
    isoscope::internal::v1::ExtractSurfaceRequest request;
    request.set_dataset_id(dataset.dataset.dataset_id());
    request.set_isovalue(spec_.isovalues[surface_index]);
    if (request_.has_clip()) {
      *request.mutable_clip() = request_.clip();
    }
    std::vector<std::unique_ptr<SurfaceStream>> streams;
    std::vector<SurfaceSource*> sources;
    for (FramePart& part : service_->options_.runner->PartsOf(dataset)) {
      streams.push_back(std::make_unique<SurfaceStream>(
          std::move(part), volume.layout, request, cancellation_.deadline(),
          service_->options_.max_agent_silence, identity_));
      sources.push_back(streams.back().get());
    }
    ShareStreams(streams);
    absl::StatusOr<std::int64_t> vertex_count =
        ExportSurface(volume, sources, first_vertex, [&](SurfaceChunk chunk) {
          return Send(std::move(chunk), static_cast<std::int32_t>(surface_index));
        });
    ShareStreams({});
    std::vector<AgentFailure> failures;
    for (const std::unique_ptr<SurfaceStream>& stream : streams) {
      failures.insert(failures.end(), stream->failures().begin(), stream->failures().end());
    }
    service_->options_.runner->ReportFailures(identity_, /*frame_number=*/0, failures);
    return vertex_count;
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

  static std::int64_t BytesOf(const isoscope::v1::ExportIsosurfaceResponse& message) {
    return static_cast<std::int64_t>(message.positions().size() + message.normals().size() +
                                     message.triangles().size());
  }

  absl::Status Send(SurfaceChunk chunk, std::int32_t surface_index) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    sent_bytes_ += chunk.size_bytes();
    caller_.CountBytes(chunk.size_bytes());
    isoscope::v1::ExportIsosurfaceResponse message;
    message.set_positions(std::move(chunk.positions));
    message.set_normals(std::move(chunk.normals));
    message.set_triangles(std::move(chunk.triangles));
    message.set_surface_index(surface_index);
    unsent_.Add(BytesOf(message));  // what is never written goes with the call
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  IsosurfaceServiceImpl* const service_;
  const isoscope::v1::ExportIsosurfaceRequest request_;
  const base::TraceContext identity_;
  const absl::Time arrival_ = absl::Now();
  Caller caller_;  // set before Run
  std::optional<CallerSlot> slot_;
  std::optional<WithdrawalWatch> watch_;
  std::optional<Admission::Place> place_;
  Admission::Ticket ticket_ = 0;  // of the place; 0: none
  rpc::ExportSpec spec_;          // set before Run
  base::Cancellation cancellation_;
  // Kept until the client has the last chunk: many slow clients hold as many queues.
  std::optional<base::MemoryBudget::Reservation> memory_;
  base::GaugeShare unsent_;
  std::atomic<std::int64_t> in_flight_unsent_bytes_{0};
  rpc::WriteTimeout timeout_;
  rpc::WriteQueue<isoscope::v1::ExportIsosurfaceResponse> outgoing_;
  std::atomic<std::size_t> sent_bytes_{0};
  base::Mutex early_end_mutex_;  // held while an alarm or a watch ends the export; the first taken
  base::Mutex pace_mutex_;       // never held where outgoing_ is called
  std::optional<ExportPace> pace_ ABSL_GUARDED_BY(pace_mutex_);  // from its turn on
  std::size_t in_flight_bytes_ ABSL_GUARDED_BY(pace_mutex_) = 0;
  std::unique_ptr<grpc::Alarm> alarm_ ABSL_GUARDED_BY(pace_mutex_);
  bool is_done_ ABSL_GUARDED_BY(pace_mutex_) = false;
  absl::Status end_ ABSL_GUARDED_BY(pace_mutex_);  // why it was ended early
  base::Mutex audit_mutex_;
  AuditRecord audit_ ABSL_GUARDED_BY(audit_mutex_);
  base::Mutex streams_mutex_;
  std::vector<SurfaceStream*> streams_ ABSL_GUARDED_BY(streams_mutex_);
  std::shared_ptr<ExportCall> self_;  // reset by OnDone
};

IsosurfaceServiceImpl::IsosurfaceServiceImpl(const IsosurfaceServiceOptions& options)
    : options_(options),
      exports_({.limits = {.max_working = kMaxConcurrentExports, .max_waiting = kMaxQueuedExports},
                .noun = "export",
                .flags = ""}) {
  rpc::PrepareKnownFields(isoscope::v1::RenderIsosurfaceRequest());
  rpc::PrepareKnownFields(isoscope::v1::PickSurfaceRequest());
}

IsosurfaceServiceImpl::~IsosurfaceServiceImpl() = default;

std::unique_ptr<FrameCall> IsosurfaceServiceImpl::MakeCall(
    grpc::CallbackServerContext* context, const v1::RenderIsosurfaceRequest& request,
    Delivery delivery) const {
  return std::make_unique<FrameCall>(options_.runner,
                                     FrameOrigin{.request = rpc::AnswerTraceContext(context),
                                                 .client = context->peer(),
                                                 .certificate = rpc::PeerOf(*context).name},
                                     request, delivery, rpc::DeadlineOf(*context),
                                     options_.max_frame_duration);
}

absl::Status IsosurfaceServiceImpl::Identify(const grpc::CallbackServerContext& context,
                                             FrameCall* frame) const {
  ISOSCOPE_ASSIGN_OR_RETURN(Caller caller, options_.access->Identify(rpc::PeerOf(context)));
  frame->SetCaller(std::move(caller), /*is_moving=*/false);
  return absl::OkStatus();
}

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::RenderIsosurface(
    grpc::CallbackServerContext* context, const v1::RenderIsosurfaceRequest* request,
    v1::RenderIsosurfaceResponse* response) {
  auto frame = MakeCall(context, *request, Delivery::kWhole);
  absl::Status admitted = Identify(*context, frame.get());
  if (admitted.ok()) {
    admitted = frame->Admit();
  }
  return UnaryCall<v1::RenderIsosurfaceResponse>::Start(
      RequestMethod::kRenderIsosurface, context, options_.max_frame_duration, std::move(frame),
      admitted, &FrameCall::Render, response);
}

grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse>*
IsosurfaceServiceImpl::RenderIsosurfaceStream(grpc::CallbackServerContext* context,
                                              const v1::RenderIsosurfaceStreamRequest* request) {
  auto frame = MakeCall(context, request->request(), Delivery::kParts);
  absl::Status admitted = Identify(*context, frame.get());
  if (admitted.ok()) {
    admitted = rpc::CheckKnownFields(*request);
  }
  if (admitted.ok()) {
    admitted = frame->Admit();
  }
  return StreamCall::Start(context, std::move(frame), admitted);
}

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::PickSurface(grpc::CallbackServerContext* context,
                                                             const v1::PickSurfaceRequest* request,
                                                             v1::PickSurfaceResponse* response) {
  auto frame = MakeCall(context, request->frame(), Delivery::kWhole);
  absl::Status admitted = Identify(*context, frame.get());
  if (admitted.ok()) {
    admitted = frame->AdmitPick(*request);
  }
  return UnaryCall<v1::PickSurfaceResponse>::Start(RequestMethod::kPickSurface, context,
                                                   options_.max_frame_duration, std::move(frame),
                                                   admitted, &FrameCall::Pick, response);
}

grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>*
IsosurfaceServiceImpl::ExportIsosurface(grpc::CallbackServerContext* context,
                                        const isoscope::v1::ExportIsosurfaceRequest* request) {
  return ExportCall::Start(this, context, request);
}

}  // namespace isoscope::server
