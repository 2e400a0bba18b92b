// As with FrameStream of the coordinator, a hold keeps gRPC from ending the stream between two
// writes, which begin outside reactions; the end of the reads releases it.

#include "web-gateway/interact_stream.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/rpc/grpc_status.h"
#include "core/rpc/request_context.h"

namespace isoscope::gateway {

namespace v1 = isoscope::v1;

std::shared_ptr<InteractStream> InteractStream::Open(CoordinatorClient* client,
                                                     const std::string& token,
                                                     const base::TraceContext& identity,
                                                     OnResponse on_response, OnEnd on_end) {
  CallCounter* const calls = client->calls();
  calls->Add();
  // Whoever drops the last reference: the counter goes last, and with it the channel may go.
  std::shared_ptr<InteractStream> stream(
      new InteractStream(client, std::move(on_response), std::move(on_end)),
      [calls](InteractStream* ended) {
        delete ended;
        calls->Remove();
      });
  stream->self_ = stream;
  client->SendToken(token, &stream->context_);
  rpc::SetTraceparent(identity, &stream->context_);
  client->interact()->async()->Interact(&stream->context_, stream.get());
  stream->AddHold();
  stream->StartRead(&stream->incoming_);
  stream->StartCall();
  return stream;
}

void InteractStream::Send(v1::InteractRequest request) {
  const base::MutexLock lock(&mutex_);
  if (reads_have_ended_ || !error_.ok()) {
    return;
  }
  if (request.has_view_state()) {
    state_ = std::move(request);
  } else if (reports_.size() < kMaxWaitingReports) {
    reports_.push_back(std::move(request));
  } else {
    error_ =
        absl::InvalidArgumentError(absl::StrCat("more than ", kMaxWaitingReports,
                                                " messages frameShown came faster than they can be "
                                                "passed on: send one for each frame"));
    context_.TryCancel();
    return;
  }
  StartNextWrite();
}

void InteractStream::StartNextWrite() {
  if (is_writing_ || reads_have_ended_) {
    return;
  }
  if (!reports_.empty()) {
    outgoing_ = std::move(reports_.front());
    reports_.pop_front();
  } else if (state_) {
    outgoing_ = *std::exchange(state_, std::nullopt);
  } else {
    return;
  }
  is_writing_ = true;
  StartWrite(&outgoing_);
}

void InteractStream::OnReadDone(bool ok) {
  if (ok) {
    on_response_(std::move(incoming_));
    incoming_.Clear();
    StartRead(&incoming_);
    return;
  }
  {
    const base::MutexLock lock(&mutex_);
    reads_have_ended_ = true;
  }
  RemoveHold();
}

void InteractStream::OnWriteDone(bool ok) {
  const base::MutexLock lock(&mutex_);
  is_writing_ = false;
  if (ok) {
    StartNextWrite();
  }
}

void InteractStream::OnDone(const grpc::Status& status) {
  absl::Status end;
  {
    const base::MutexLock lock(&mutex_);
    end = error_.ok() ? client_->Explain(rpc::ToAbslStatus(status)) : error_;
  }
  std::exchange(on_end_, nullptr)(end);
  on_response_ = nullptr;  // what it holds may hold this stream
  const std::shared_ptr<InteractStream> last_use = std::move(self_);
}

}  // namespace isoscope::gateway
