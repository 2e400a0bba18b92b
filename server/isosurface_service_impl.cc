// The reactor of a frame or a pick owns a ticket and a job, and itself until gRPC is done with it:
//
//   handler       ticket made, caller identified, Job::Admit    on gRPC's thread
//   turn comes    Job::Run, then the answer                     on a frame thread
//   OnCancel      the ticket is cancelled, which wakes the job
//   OnDone        the reactor goes, with the memory of the answer

#include "server/isosurface_service_impl.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "core/base/status_macros.h"
#include "core/rpc/channel.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/peer.h"
#include "core/rpc/request_context.h"
#include "core/rpc/response_splitter.h"
#include "core/rpc/write_timeout.h"
#include "server/frame/pick_job.h"
#include "server/frame/picture_job.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// In which a client must take a part of an answer. A whole answer may take as long as a frame.
constexpr absl::Duration kMaxPartDuration = absl::Minutes(1);

// A call of which `Job` makes the answer, and `Reactor` sends it.
template <typename Reactor, typename Job>
class FrameCall : public Reactor {
 public:
  FrameCall(RequestMethod method, grpc::CallbackServerContext* context,
            const IsosurfaceServiceOptions& options, FrameClaim claim)
      : method_(method),
        caller_(options.access->Identify(rpc::PeerOf(*context))),
        unsent_(&options.runner->metrics()->unsent_bytes),
        timeout_(context) {
    claim.client_deadline = rpc::DeadlineOf(*context);
    claim.max_duration = options.max_frame_duration;
    const FrameOrigin origin{.request = rpc::AnswerTraceContext(context),
                             .client = context->peer(),
                             .certificate = rpc::PeerOf(*context).name,
                             .caller = caller_.ok() ? *caller_ : Caller()};
    ticket_ = std::make_shared<FrameTicket>(options.runner, origin, claim);
  }

  // Answers the call, or refuses it with `checked`. `self` owns the call.
  FrameCall* Start(std::shared_ptr<FrameCall> self, const typename Job::Request& request,
                   const absl::Status& checked = absl::OkStatus()) {
    self_ = self;
    const absl::Status admitted = Admit(request, checked);
    if (admitted.ok()) {
      ticket_->Schedule([self = std::move(self)] { self->Work(); });
    } else {
      End(admitted);
    }
    return this;
  }

  void OnCancel() override { ticket_->Cancel(); }
  void OnDone() override {
    timeout_.Stop();
    const std::shared_ptr<FrameCall> last_use = std::move(self_);
  }

 protected:
  // Makes and sends the answer, on a frame thread.
  virtual void Work() = 0;

  void End(const absl::Status& status) {
    ticket_->EndRequest(method_, status);
    this->Finish(rpc::ToGrpcStatus(status));
  }
  // The answer is on its way: its images and the rest of its memory go.
  void KeepOnlyAnswer(std::size_t answer_bytes) {
    job_.reset();
    ticket_->KeepMemoryOfAnswer(answer_bytes);
  }

  [[nodiscard]] Job* job() const { return job_.get(); }
  void CountUnsent(std::size_t bytes) { unsent_.Set(static_cast<std::int64_t>(bytes)); }
  void StartTimeout(absl::Duration timeout) { timeout_.Start(timeout); }

 private:
  absl::Status Admit(const typename Job::Request& request, const absl::Status& checked) {
    ISOSCOPE_RETURN_IF_ERROR(caller_.status());
    ISOSCOPE_RETURN_IF_ERROR(checked);
    ISOSCOPE_ASSIGN_OR_RETURN(job_, Job::Admit(ticket_, request));
    return absl::OkStatus();
  }

  const RequestMethod method_;
  const absl::StatusOr<Caller> caller_;
  std::shared_ptr<FrameTicket> ticket_;
  std::unique_ptr<Job> job_;  // while it works
  base::GaugeShare unsent_;   // until OnDone
  rpc::WriteTimeout timeout_;
  std::shared_ptr<FrameCall> self_;  // reset by OnDone
};

// A call with one response.
template <typename Job>
class WholeCall final : public FrameCall<grpc::ServerUnaryReactor, Job> {
 public:
  WholeCall(RequestMethod method, grpc::CallbackServerContext* context,
            const IsosurfaceServiceOptions& options, const FrameClaim& claim,
            typename Job::Response* response)
      : FrameCall<grpc::ServerUnaryReactor, Job>(method, context, options, claim),
        max_write_duration_(options.max_frame_duration),
        response_(response) {}

 private:
  void Work() override {
    const absl::Status status = this->job()->Run(response_);
    const std::size_t answer_bytes = status.ok() ? response_->ByteSizeLong() : 0;
    this->CountUnsent(answer_bytes);
    this->StartTimeout(max_write_duration_);
    this->End(status);
    this->KeepOnlyAnswer(answer_bytes);
  }

  const absl::Duration max_write_duration_;
  typename Job::Response* const response_;
};

// A frame whose response goes out in parts. It is complete before the first part is sent, so no
// thread waits for a slow client.
class PartsCall final
    : public FrameCall<grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse>, PictureJob> {
 public:
  using FrameCall::FrameCall;

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      End(absl::CancelledError("the client cancelled the frame"));
    }
  }

 private:
  void Work() override {
    v1::RenderIsosurfaceResponse response;
    const absl::Status status = job()->Run(&response);
    if (!status.ok()) {
      End(status);
      return;
    }
    const std::size_t answer_bytes = response.ByteSizeLong();
    CountUnsent(answer_bytes);
    splitter_.emplace(std::move(response));
    WriteNext();
    KeepOnlyAnswer(answer_bytes);
  }

  void WriteNext() {
    message_.Clear();
    if (!splitter_->Next(message_.mutable_part())) {
      End(absl::OkStatus());
      return;
    }
    StartTimeout(kMaxPartDuration);
    StartWrite(&message_);
  }

  std::optional<rpc::ResponseSplitter> splitter_;
  v1::RenderIsosurfaceStreamResponse message_;
};

FrameClaim ClaimOf(const v1::RenderIsosurfaceRequest& request) {
  return {.dataset = request.dataset(), .has_trace = request.with_trace()};
}

}  // namespace

IsosurfaceServiceImpl::IsosurfaceServiceImpl(const IsosurfaceServiceOptions& options)
    : options_(options),
      exports_({.limits = {.max_working = kMaxConcurrentExports, .max_waiting = kMaxQueuedExports},
                .noun = "export",
                .flags = ""}) {
  rpc::PrepareKnownFields(v1::RenderIsosurfaceRequest());
  rpc::PrepareKnownFields(v1::PickSurfaceRequest());
}

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::RenderIsosurface(
    grpc::CallbackServerContext* context, const v1::RenderIsosurfaceRequest* request,
    v1::RenderIsosurfaceResponse* response) {
  const auto call = std::make_shared<WholeCall<PictureJob>>(
      RequestMethod::kRenderIsosurface, context, options_, ClaimOf(*request), response);
  return call->Start(call, *request);
}

grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse>*
IsosurfaceServiceImpl::RenderIsosurfaceStream(grpc::CallbackServerContext* context,
                                              const v1::RenderIsosurfaceStreamRequest* request) {
  FrameClaim claim = ClaimOf(request->request());
  claim.delivery = Delivery::kParts;
  const auto call =
      std::make_shared<PartsCall>(RequestMethod::kRenderIsosurfaceStream, context, options_, claim);
  return call->Start(call, request->request(), rpc::CheckKnownFields(*request));
}

grpc::ServerUnaryReactor* IsosurfaceServiceImpl::PickSurface(grpc::CallbackServerContext* context,
                                                             const v1::PickSurfaceRequest* request,
                                                             v1::PickSurfaceResponse* response) {
  FrameClaim claim = ClaimOf(request->frame());
  claim.noun = "pick";
  const auto call = std::make_shared<WholeCall<PickJob>>(RequestMethod::kPickSurface, context,
                                                         options_, claim, response);
  return call->Start(call, *request);
}

grpc::ServerWriteReactor<v1::ExportIsosurfaceResponse>* IsosurfaceServiceImpl::ExportIsosurface(
    grpc::CallbackServerContext* context, const v1::ExportIsosurfaceRequest* request) {
  return StartExportCall({.registry = options_.registry,
                          .runner = options_.runner,
                          .access = options_.access,
                          .admission = &exports_,
                          .max_agent_silence = options_.max_agent_silence,
                          .limits = options_.export_limits},
                         context, *request);
}

}  // namespace isoscope::server
