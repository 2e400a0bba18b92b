// As with FrameStream of the coordinator, a hold keeps gRPC from ending the stream between two
// writes, which begin outside reactions. The end of the reads releases the hold.

#include "web-gateway/api/interact_stream.h"

#include <deque>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include <grpcpp/support/client_callback.h>

#include "clients/cpp/connection/coordinator_channel.h"
#include "core/base/mutex.h"
#include "rpc/grpc_status.h"

namespace isoscope::gateway {

namespace v1 = isoscope::v1;

namespace {

class InteractStreamImpl final
    : public InteractStream,
      private grpc::ClientBidiReactor<v1::InteractRequest, v1::InteractResponse> {
 public:
  static std::shared_ptr<InteractStreamImpl> Open(CoordinatorClient* client,
                                                  const std::string& token,
                                                  const base::TraceContext& identity,
                                                  OnResponse on_response, OnEnd on_end);

  void Send(v1::InteractRequest request) override ABSL_LOCKS_EXCLUDED(mutex_);
  void Cancel() override { context_.get()->TryCancel(); }

 private:
  InteractStreamImpl(CoordinatorClient* client, const std::string& token,
                     const base::TraceContext& identity, OnResponse on_response, OnEnd on_end)
      : client_(client),
        on_response_(std::move(on_response)),
        on_end_(std::move(on_end)),
        context_(client->channel(), {.token = token, .identity = &identity}) {}
  ~InteractStreamImpl() override = default;

  void OnReadDone(bool ok) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnWriteDone(bool ok) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnDone(const grpc::Status& status) override ABSL_LOCKS_EXCLUDED(mutex_);
  void StartNextWrite() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  CoordinatorClient* const client_;
  OnResponse on_response_;
  OnEnd on_end_;
  std::shared_ptr<InteractStreamImpl> self_;  // until OnDone
  client::CallContext context_;
  v1::InteractResponse incoming_;

  base::Mutex mutex_;
  std::optional<v1::InteractRequest> state_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::InteractRequest> reports_ ABSL_GUARDED_BY(mutex_);
  v1::InteractRequest outgoing_ ABSL_GUARDED_BY(mutex_);
  absl::Status error_ ABSL_GUARDED_BY(mutex_) = absl::OkStatus();
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool reads_have_ended_ ABSL_GUARDED_BY(mutex_) = false;
};

std::shared_ptr<InteractStreamImpl> InteractStreamImpl::Open(CoordinatorClient* client,
                                                             const std::string& token,
                                                             const base::TraceContext& identity,
                                                             OnResponse on_response, OnEnd on_end) {
  CallCounter* const calls = client->calls();
  calls->Add();
  // If this drops the last reference, the counter goes last, and the channel may go with it.
  std::shared_ptr<InteractStreamImpl> stream(
      new InteractStreamImpl(client, token, identity, std::move(on_response), std::move(on_end)),
      [calls](InteractStreamImpl* ended) {
        delete ended;
        calls->Remove();
      });
  stream->self_ = stream;
  client->channel().interact()->async()->Interact(stream->context_.get(), stream.get());
  stream->AddHold();
  stream->StartRead(&stream->incoming_);
  stream->StartCall();
  return stream;
}

void InteractStreamImpl::Send(v1::InteractRequest request) {
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
    context_.get()->TryCancel();
    return;
  }
  StartNextWrite();
}

void InteractStreamImpl::StartNextWrite() {
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

void InteractStreamImpl::OnReadDone(bool ok) {
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

void InteractStreamImpl::OnWriteDone(bool ok) {
  const base::MutexLock lock(&mutex_);
  is_writing_ = false;
  if (ok) {
    StartNextWrite();
  }
}

void InteractStreamImpl::OnDone(const grpc::Status& status) {
  absl::Status end;
  {
    const base::MutexLock lock(&mutex_);
    end = error_.ok() ? client_->channel().NameAddress(rpc::ToAbslStatus(status)) : error_;
  }
  std::exchange(on_end_, nullptr)(end);
  on_response_ = nullptr;  // its captures may hold this stream
  const std::shared_ptr<InteractStreamImpl> last_use = std::move(self_);
}

}  // namespace

std::shared_ptr<InteractStream> InteractStream::Open(CoordinatorClient* client,
                                                     const std::string& token,
                                                     const base::TraceContext& identity,
                                                     OnResponse on_response, OnEnd on_end) {
  return InteractStreamImpl::Open(client, token, identity, std::move(on_response),
                                  std::move(on_end));
}

}  // namespace isoscope::gateway
