// The reactor of a frame or a pick owns a ticket and a job, and itself until gRPC is done with it:
//
//   handler       ticket made, caller identified, Job::Admit    on gRPC's thread
//   turn comes    Job::Run, then the answer                     on a frame thread
//   OnCancel      the ticket is cancelled, which wakes the job
//   OnDone        the reactor goes, with the memory of the answer

#include "server/isosurface_service_impl.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "core/base/status_macros.h"
#include "server/call/public_call.h"
#include "server/frame/frame_ticket.h"
#include "server/frame/pick_job.h"
#include "server/frame/picture_job.h"
#include "wire/known_fields.h"
#include "wire/response_splitter.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// A client must take a part of an answer within this time. A whole answer may take as long as a
// frame.
constexpr absl::Duration kMaxPartDuration = absl::Minutes(1);

// A call whose answer `Job` makes and `Reactor` sends.
template <typename Reactor, typename Job>
class FrameCall : public Reactor {
 public:
  // Answers the call, or refuses it with `checked`. `self` owns it.
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
    call_.timeout().Stop();
    const std::shared_ptr<FrameCall> last_use = std::move(self_);
  }

 protected:
  // `response` outlives the work.
  FrameCall(RequestMethod method, grpc::CallbackServerContext* context,
            const IsosurfaceServiceOptions& options, FrameClaim claim,
            typename Job::Response* response)
      : runner_(*options.runner),
        call_(&options.state->calls, method, context),
        identified_(call_.Identify()),
        response_(*response) {
    claim.client_deadline = call_.deadline();
    claim.max_duration = options.max_frame_duration;
    ticket_ = std::make_shared<FrameTicket>(options.state, call_.origin(), claim);
  }

  // Begins to send the response, or ends the call with an error.
  virtual void Send(const absl::Status& status) = 0;
  void StartTimeout(absl::Duration timeout) { call_.timeout().Start(timeout); }
  void End(const absl::Status& status) {
    call_.NoteDataset(ticket_->dataset());
    this->Finish(call_.End(status));
  }

 private:
  absl::Status Admit(const typename Job::Request& request, const absl::Status& checked) {
    ISOSCOPE_RETURN_IF_ERROR(identified_);
    ISOSCOPE_RETURN_IF_ERROR(checked);
    ISOSCOPE_ASSIGN_OR_RETURN(job_, Job::Admit(&runner_, ticket_, request));
    return absl::OkStatus();
  }

  // Runs on a frame thread.
  void Work() {
    const absl::Status status = job_->Run(&response_);
    const std::size_t answer_bytes = status.ok() ? response_.ByteSizeLong() : 0;
    call_.unsent().Set(static_cast<std::int64_t>(answer_bytes));
    Send(status);
    // The answer is on its way: release its images and the rest of its memory.
    job_.reset();
    ticket_->KeepMemoryOfAnswer(answer_bytes);
  }

  FrameRunner& runner_;
  PublicCall call_;
  const absl::Status identified_;
  typename Job::Response& response_;
  std::shared_ptr<FrameTicket> ticket_;
  std::unique_ptr<Job> job_;         // while it works
  std::shared_ptr<FrameCall> self_;  // reset by OnDone
};

// A call with one response.
template <typename Job>
class WholeCall final : public FrameCall<grpc::ServerUnaryReactor, Job> {
 public:
  WholeCall(RequestMethod method, grpc::CallbackServerContext* context,
            const IsosurfaceServiceOptions& options, const FrameClaim& claim,
            typename Job::Response* response)
      : FrameCall<grpc::ServerUnaryReactor, Job>(method, context, options, claim, response),
        max_write_duration_(options.max_frame_duration) {}

 private:
  void Send(const absl::Status& status) override {
    this->StartTimeout(max_write_duration_);
    this->End(status);
  }

  const absl::Duration max_write_duration_;
};

// A frame whose response goes out in parts. It is complete before the first part is sent, so no
// thread waits for a slow client.
class PartsCall final
    : public FrameCall<grpc::ServerWriteReactor<v1::RenderIsosurfaceStreamResponse>, PictureJob> {
 public:
  PartsCall(grpc::CallbackServerContext* context, const IsosurfaceServiceOptions& options,
            const FrameClaim& claim)
      : FrameCall(RequestMethod::kRenderIsosurfaceStream, context, options, claim, &whole_) {}

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      End(absl::CancelledError("the client cancelled the frame"));
    }
  }

 private:
  void Send(const absl::Status& status) override {
    if (!status.ok()) {
      End(status);
      return;
    }
    splitter_.emplace(std::move(whole_));
    WriteNext();
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

  v1::RenderIsosurfaceResponse whole_;
  std::optional<wire::ResponseSplitter> splitter_;
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
  wire::PrepareKnownFields(v1::RenderIsosurfaceRequest());
  wire::PrepareKnownFields(v1::PickSurfaceRequest());
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
  const auto call = std::make_shared<PartsCall>(context, options_, claim);
  return call->Start(call, request->request(), wire::CheckKnownFields(*request));
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

}  // namespace isoscope::server
