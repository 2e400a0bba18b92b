// A blocking call, in Call:
//
// 1. The context gets the deadline, the trace identity, the token and the interrupt (CallContext).
// 2. The stub's method runs. If the server refuses it with a retry delay, CallWithRetries repeats
//    it.
// 3. Explain turns the status into an error with advice: start a server, show a token, ask the
//    operator with the id of the request.
//
// An answer in parts begins anew with each attempt. An export whose chunks were visited is never
// repeated: the visitor can't undo them.

#include "clients/cpp/connection/service_client.h"

#include <cstdlib>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/coordinator_channel.h"
#include "clients/cpp/connection/retries.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "rpc/grpc_status.h"
#include "rpc/read_timeout.h"
#include "rpc/request_context.h"
#include "rpc/signs_of_life.h"
#include "wire/response_splitter.h"

namespace isoscope::client {

namespace v1 = isoscope::v1;

namespace {

// A server ends a frame up to 200 ms before its client's deadline, to report the reason; this
// leaves time for the answer's transport.
constexpr absl::Duration kAnswerMargin = absl::Milliseconds(500);

// Returns true if the servers' logs may have more details.
bool IsForOperator(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status) ||
         absl::IsDataLoss(status) || absl::IsInternal(status) || absl::IsUnknown(status) ||
         absl::IsFailedPrecondition(status) || absl::IsResourceExhausted(status);
}

absl::Status WithRequestId(const absl::Status& status, const std::string& request_id) {
  return request_id.empty()
             ? status
             : absl::Status(status.code(),
                            absl::StrCat(status.message(), " (request ", request_id, ")"));
}

class InteractStreamImpl final : public InteractStream {
 public:
  explicit InteractStreamImpl(const CoordinatorChannel& channel)
      : context_(channel, {}), stream_(channel.interact()->Interact(context_.get())) {}
  InteractStreamImpl(const InteractStreamImpl&) = delete;
  InteractStreamImpl& operator=(const InteractStreamImpl&) = delete;
  ~InteractStreamImpl() override { context_.get()->TryCancel(); }

  bool Write(const v1::InteractRequest& request) override ABSL_LOCKS_EXCLUDED(write_mutex_) {
    const base::MutexLock lock(&write_mutex_);
    return stream_->Write(request);
  }
  bool Read(v1::InteractResponse* response) override { return stream_->Read(response); }
  void Cancel() override { context_.get()->TryCancel(); }
  absl::Status Finish() override { return rpc::ToAbslStatus(stream_->Finish()); }

 private:
  CallContext context_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::InteractRequest, v1::InteractResponse>>
      stream_;
  base::Mutex write_mutex_;
};

}  // namespace

ServiceClient::ServiceClient(std::shared_ptr<grpc::Channel> channel, std::string address,
                             cli::Interrupt* interrupt, std::string token)
    : channel_(std::make_unique<CoordinatorChannel>(std::move(channel), std::move(address),
                                                    std::move(token))),
      interrupt_(interrupt == nullptr ? never_ : interrupt->cancellation()) {}

ServiceClient::~ServiceClient() = default;

const std::shared_ptr<grpc::Channel>& ServiceClient::channel() const { return channel_->channel(); }

std::unique_ptr<InteractStream> ServiceClient::Interact() const {
  return std::make_unique<InteractStreamImpl>(*channel_);
}

absl::Status ServiceClient::Explain(const grpc::Status& status,
                                    base::MonotonicTime deadline) const {
  if (status.ok()) {
    return absl::OkStatus();
  }
  if (interrupt_.is_cancelled()) {
    return absl::CancelledError("interrupted");
  }
  absl::Status explained = rpc::ToAbslStatus(status);
  if (absl::IsCancelled(explained)) {
    // Not cancelled by this process: a server that shuts down ends calls that it has not begun with
    // this.
    return absl::UnavailableError(absl::StrCat(
        "the server ended the call, as it does when it shuts down (", explained.message(), ")"));
  }
  explained = channel_->NameAddress(
      explained, absl::StrCat("; start one with 'isoscope serve DIR --listen ", channel_->address(),
                              "' or isoscope-coordinator"));
  if (absl::IsDeadlineExceeded(explained) && base::MonotonicNow() + kAnswerMargin >= deadline) {
    return absl::DeadlineExceededError(
        absl::StrCat(explained.message(), "; --timeout gives it more time"));
  }
  return explained;
}

absl::Status ServiceClient::Call(absl::Duration timeout,
                                 absl::FunctionRef<grpc::Status(grpc::ClientContext*)> call) const {
  const base::MonotonicTime deadline = base::MonotonicNow() + timeout;
  const char* const traceparent = std::getenv("TRACEPARENT");
  const std::optional<base::TraceContext> caller =
      base::TraceContext::Parse(traceparent == nullptr ? "" : traceparent);
  std::string request_id;
  const absl::Status status = CallWithRetries(deadline, interrupt_, [&] {
    CallContext context(*channel_, {.deadline = deadline,
                                    .identity = caller.has_value() ? &*caller : nullptr,
                                    .cancellation = &interrupt_});
    absl::Status explained = Explain(call(context.get()), deadline);
    request_id = rpc::RequestIdOf(*context.get());
    return explained;
  });
  return IsForOperator(status) ? WithRequestId(status, request_id) : status;
}

template <typename Response, typename Stub, typename Request>
absl::StatusOr<Response> ServiceClient::CallUnary(
    Stub* stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
    const Request& request, absl::Duration timeout) const {
  Response response;
  ISOSCOPE_RETURN_IF_ERROR(Call(timeout, [&](grpc::ClientContext* context) {
    return (stub->*method)(context, request, &response);
  }));
  return response;
}

absl::StatusOr<v1::Dataset> ServiceClient::GetDataset(const std::string& name,
                                                      absl::Duration timeout) {
  v1::GetDatasetRequest request;
  request.set_name(name);
  ISOSCOPE_ASSIGN_OR_RETURN(
      v1::GetDatasetResponse response,
      CallUnary(channel_->dataset(), &v1::DatasetService::Stub::GetDataset, request, timeout));
  return std::move(*response.mutable_dataset());
}

absl::StatusOr<v1::GetHistogramResponse> ServiceClient::GetHistogram(
    const v1::GetHistogramRequest& request, absl::Duration timeout) {
  return CallUnary(channel_->dataset(), &v1::DatasetService::Stub::GetHistogram, request, timeout);
}

absl::StatusOr<v1::ListDatasetsResponse> ServiceClient::ListDatasets(absl::Duration timeout) {
  return CallUnary(channel_->dataset(), &v1::DatasetService::Stub::ListDatasets,
                   v1::ListDatasetsRequest(), timeout);
}

absl::StatusOr<v1::GetCapabilitiesResponse> ServiceClient::GetCapabilities(absl::Duration timeout) {
  return CallUnary(channel_->cluster(), &v1::ClusterService::Stub::GetCapabilities,
                   v1::GetCapabilitiesRequest(), timeout);
}

absl::StatusOr<v1::GetClusterStatusResponse> ServiceClient::GetClusterStatus(
    absl::Duration timeout) {
  return CallUnary(channel_->cluster(), &v1::ClusterService::Stub::GetClusterStatus,
                   v1::GetClusterStatusRequest(), timeout);
}

absl::StatusOr<v1::RenderIsosurfaceResponse> ServiceClient::RenderIsosurface(
    const v1::RenderIsosurfaceRequest& request, absl::Duration timeout) {
  return CallUnary(channel_->isosurface(), &v1::IsosurfaceService::Stub::RenderIsosurface, request,
                   timeout);
}

absl::StatusOr<v1::RenderIsosurfaceResponse> ServiceClient::RenderIsosurfaceStream(
    const v1::RenderIsosurfaceRequest& request, absl::Duration timeout) {
  v1::RenderIsosurfaceStreamRequest in_parts;
  *in_parts.mutable_request() = request;
  v1::RenderIsosurfaceResponse response;
  ISOSCOPE_RETURN_IF_ERROR(Call(timeout, [&](grpc::ClientContext* context) {
    const std::unique_ptr<grpc::ClientReader<v1::RenderIsosurfaceStreamResponse>> reader =
        channel_->isosurface()->RenderIsosurfaceStream(context, in_parts);
    response.Clear();  // of an earlier attempt
    v1::RenderIsosurfaceStreamResponse message;
    while (reader->Read(&message)) {
      wire::AppendPart(std::move(*message.mutable_part()), &response);
    }
    return reader->Finish();
  }));
  return response;
}

absl::StatusOr<v1::PickSurfaceResponse> ServiceClient::PickSurface(
    const v1::PickSurfaceRequest& request, absl::Duration timeout) {
  return CallUnary(channel_->isosurface(), &v1::IsosurfaceService::Stub::PickSurface, request,
                   timeout);
}

absl::Status ServiceClient::ExportIsosurface(
    const v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
    absl::FunctionRef<absl::Status(const v1::ExportIsosurfaceResponse&)> visit,
    absl::Duration max_silence) {
  absl::Status visited = absl::OkStatus();
  const absl::Status called = Call(timeout, [&](grpc::ClientContext* context) {
    const std::unique_ptr<grpc::ClientReader<v1::ExportIsosurfaceResponse>> reader =
        channel_->isosurface()->ExportIsosurface(context, request);
    v1::ExportIsosurfaceResponse chunk;
    bool has_chunks = false;
    bool is_silent = false;
    const auto read = [&] {
      rpc::ReadTimeout silence(context, max_silence);
      const bool has_chunk = reader->Read(&chunk);
      is_silent = silence.Stop();
      return has_chunk && !is_silent;
    };
    while (visited.ok() && read()) {
      if (!rpc::IsSignOfLife(chunk)) {
        visited = visit(chunk);
        has_chunks = true;
      }
    }
    if (!visited.ok()) {
      context->TryCancel();
    }
    const grpc::Status status = reader->Finish();
    if (is_silent) {
      return grpc::Status(
          grpc::StatusCode::DEADLINE_EXCEEDED,
          absl::StrCat("the server sent nothing for ", absl::FormatDuration(max_silence)));
    }
    // Without details it is not retried: visited chunks can't be undone.
    return has_chunks ? grpc::Status(status.error_code(), status.error_message()) : status;
  });
  return visited.ok() ? called : visited;
}

}  // namespace isoscope::client
