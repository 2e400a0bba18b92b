// Each call owns itself: it lies on the heap, and its last reaction deletes it.
//
// 1. The constructor sets deadline, token and identity; Start begins the stub's asynchronous
//    method.
// 2. A reaction hands the answer, or each message of a stream, to the caller's function.
// 3. The last reaction deletes the call, and only then removes it from the counter. So does the
//    alarm of a Pause.
//
// Invariant: when the counter is 0, no gRPC object of a call is left. So the client can be
// destroyed, and no thread of gRPC drops the last reference to the channel.

#include "web-gateway/api/coordinator_client.h"

#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include <grpcpp/alarm.h>
#include <grpcpp/support/client_callback.h>

#include "clients/cpp/connection/coordinator_channel.h"
#include "core/base/monotonic_time.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/signs_of_life.h"
#include "wire/response_splitter.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

// The deadline of calls that the coordinator answers from memory.
constexpr absl::Duration kQuickDuration = absl::Seconds(5);
constexpr absl::Duration kHistogramDuration = absl::Seconds(60);

// The common part of all calls: deadline, cancellation, count.
class CallBase {
 public:
  CallBase(CoordinatorClient* client, CallOptions call, absl::Duration duration)
      : client_(client),
        scope_(std::move(call.scope)),
        context_(client->channel(), {.token = std::move(call.token),
                                     .deadline = base::MonotonicNow() + duration,
                                     .identity = scope_ == nullptr ? nullptr : &scope_->identity(),
                                     .cancellation = scope_.get()}) {
    client_->calls()->Add();
  }
  CallBase(const CallBase&) = delete;
  CallBase& operator=(const CallBase&) = delete;

 protected:
  ~CallBase() = default;

  grpc::ClientContext* context() { return context_.get(); }
  [[nodiscard]] absl::Status Explain(const grpc::Status& status) const {
    return client_->channel().NameAddress(rpc::ToAbslStatus(status));
  }
  // Deletes the call; last use of `call`.
  template <typename Call>
  static void Delete(Call* call) {
    CallCounter* const calls = call->client_->calls();
    delete call;
    calls->Remove();
  }

 private:
  CoordinatorClient* const client_;
  const std::shared_ptr<RequestScope> scope_;
  client::CallContext context_;
};

template <typename Request, typename Response>
class UnaryCall final : public CallBase {
 public:
  using Done = CoordinatorClient::Done<Response>;

  UnaryCall(CoordinatorClient* client, CallOptions call_options, absl::Duration duration,
            Request request, Done done)
      : CallBase(client, std::move(call_options), duration),
        request_(std::move(request)),
        done_(std::move(done)) {}

  // begin(context, request, response, callback): the stub's method.
  template <typename Begin>
  void Start(const Begin& begin) {
    begin(context(), &request_, &response_, [this](const grpc::Status& status) {
      if (status.ok()) {
        done_(std::move(response_));
      } else {
        done_(Explain(status));
      }
      Delete(this);
    });
  }

 private:
  friend class CallBase;

  Request request_;
  Response response_;
  Done done_;
};

// A stream of answers; `visit` gets each of them.
template <typename Request, typename Message>
class ReadCall final : public CallBase, public grpc::ClientReadReactor<Message> {
 public:
  using Visit = std::function<absl::Status(Message*)>;
  using Done = std::function<void(absl::Status)>;

  ReadCall(CoordinatorClient* client, CallOptions call_options, absl::Duration duration,
           Request request, Visit visit, Done done)
      : CallBase(client, std::move(call_options), duration),
        request_(std::move(request)),
        visit_(std::move(visit)),
        done_(std::move(done)) {}

  // begin(context, request, reactor): the stub's method.
  template <typename Begin>
  void Start(const Begin& begin) {
    begin(context(), &request_, this);
    this->StartRead(&message_);
    this->StartCall();
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      return;  // OnDone follows
    }
    visited_ = visit_(&message_);
    if (visited_.ok()) {
      this->StartRead(&message_);
    } else {
      context()->TryCancel();
    }
  }

  void OnDone(const grpc::Status& status) override {
    done_(visited_.ok() ? Explain(status) : visited_);
    CallBase::Delete(this);
  }

 private:
  friend class CallBase;

  const Request request_;
  const Visit visit_;
  const Done done_;
  Message message_;
  absl::Status visited_ = absl::OkStatus();
};

// A wait between two calls, which its alarm ends.
class Pause {
 public:
  using Done = std::function<void(absl::Status)>;

  Pause(CallCounter* calls, std::shared_ptr<RequestScope> scope, Done done)
      : calls_(calls), scope_(std::move(scope)), done_(std::move(done)) {
    calls_->Add();
  }

  static void Begin(const std::shared_ptr<Pause>& pause, absl::Duration delay) {
    const base::MutexLock lock(&pause->mutex_);  // the alarm may ring at once
    pause->self_ = pause;
    pause->alarm_ = std::make_unique<grpc::Alarm>();
    pause->alarm_->Set(base::MonotonicNow() + delay,
                       [raw = pause.get()](bool /*rang*/) { End(raw->TakeSelf()); });
    if (pause->scope_ != nullptr) {
      // gRPC calls the alarm's function on another thread, also if it is cancelled.
      pause->on_cancel_.emplace(*pause->scope_, [alarm = pause->alarm_.get()] { alarm->Cancel(); });
    }
  }

 private:
  [[nodiscard]] std::shared_ptr<Pause> TakeSelf() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return std::move(self_);
  }

  static void End(std::shared_ptr<Pause> pause) {
    CallCounter* const calls = pause->calls_;
    pause->on_cancel_.reset();  // before the alarm that it uses
    pause->done_(pause->scope_ == nullptr ? absl::OkStatus() : pause->scope_->Check());
    pause.reset();
    calls->Remove();
  }

  CallCounter* const calls_;
  const std::shared_ptr<RequestScope> scope_;
  const Done done_;
  base::Mutex mutex_;
  std::shared_ptr<Pause> self_ ABSL_GUARDED_BY(mutex_);  // until the alarm has rung
  // Set once, before the alarm can end the wait.
  std::unique_ptr<grpc::Alarm> alarm_;
  std::optional<base::Cancellation::Callback> on_cancel_;
};

// Starts the unary call `method` of the stub's service.
template <typename Request, typename Response, typename Async>
void CallUnary(CoordinatorClient* client, CallOptions call_options, absl::Duration duration,
               Request request, CoordinatorClient::Done<Response> done, Async* async,
               void (Async::*method)(grpc::ClientContext*, const Request*, Response*,
                                     std::function<void(grpc::Status)>)) {
  auto* const call = new UnaryCall<Request, Response>(client, std::move(call_options), duration,
                                                      std::move(request), std::move(done));
  call->Start([&](grpc::ClientContext* context, const Request* sent, Response* received,
                  std::function<void(grpc::Status)> callback) {
    (async->*method)(context, sent, received, std::move(callback));
  });
}

}  // namespace

void CallCounter::Add() {
  const base::MutexLock lock(&mutex_);
  ++count_;
}

void CallCounter::Remove() {
  const base::MutexLock lock(&mutex_);
  if (--count_ == 0) {
    none_.SignalAll();
  }
}

void CallCounter::AwaitNone() {
  base::MutexLock lock(&mutex_);
  none_.Await(&mutex_, [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return count_ == 0; });
}

CoordinatorClient::CoordinatorClient(CoordinatorClientOptions options)
    : channel_(std::make_unique<const client::CoordinatorChannel>(
          std::move(options.channel), std::move(options.address), std::move(options.token))),
      max_duration_(options.max_duration),
      max_picture_bytes_(options.max_picture_bytes) {}

CoordinatorClient::~CoordinatorClient() { calls_.AwaitNone(); }

void CoordinatorClient::GetCapabilities(CallOptions call_options,
                                        Done<v1::GetCapabilitiesResponse> done) {
  CallUnary(this, std::move(call_options), kQuickDuration, v1::GetCapabilitiesRequest(),
            std::move(done), channel_->cluster()->async(),
            &v1::ClusterService::Stub::async::GetCapabilities);
}

void CoordinatorClient::GetClusterStatus(CallOptions call_options,
                                         Done<v1::GetClusterStatusResponse> done) {
  CallUnary(this, std::move(call_options), kQuickDuration, v1::GetClusterStatusRequest(),
            std::move(done), channel_->cluster()->async(),
            &v1::ClusterService::Stub::async::GetClusterStatus);
}

void CoordinatorClient::ListDatasets(CallOptions call_options,
                                     Done<v1::ListDatasetsResponse> done) {
  CallUnary(this, std::move(call_options), kQuickDuration, v1::ListDatasetsRequest(),
            std::move(done), channel_->dataset()->async(),
            &v1::DatasetService::Stub::async::ListDatasets);
}

void CoordinatorClient::GetDataset(v1::GetDatasetRequest request, CallOptions call_options,
                                   Done<v1::GetDatasetResponse> done) {
  CallUnary(this, std::move(call_options), kQuickDuration, std::move(request), std::move(done),
            channel_->dataset()->async(), &v1::DatasetService::Stub::async::GetDataset);
}

void CoordinatorClient::GetHistogram(v1::GetHistogramRequest request, CallOptions call_options,
                                     Done<v1::GetHistogramResponse> done) {
  CallUnary(this, std::move(call_options), kHistogramDuration, std::move(request), std::move(done),
            channel_->dataset()->async(), &v1::DatasetService::Stub::async::GetHistogram);
}

void CoordinatorClient::PickSurface(v1::PickSurfaceRequest request, CallOptions call_options,
                                    Done<v1::PickSurfaceResponse> done) {
  CallUnary(this, std::move(call_options), max_duration_, std::move(request), std::move(done),
            channel_->isosurface()->async(), &v1::IsosurfaceService::Stub::async::PickSurface);
}

void CoordinatorClient::Render(v1::RenderIsosurfaceRequest request, CallOptions call_options,
                               Done<v1::RenderIsosurfaceResponse> done) {
  v1::RenderIsosurfaceStreamRequest in_parts;
  *in_parts.mutable_request() = std::move(request);
  struct Whole {
    v1::RenderIsosurfaceResponse response;
    std::size_t bytes = 0;
  };
  const auto whole = std::make_shared<Whole>();
  const auto append = [whole, limit = max_picture_bytes_, output = in_parts.request().output()](
                          v1::RenderIsosurfaceStreamResponse* message) -> absl::Status {
    const bool is_first = whole->bytes == 0;
    whole->bytes += message->ByteSizeLong();
    if (whole->bytes > limit) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the picture has more than ", limit,
                       " bytes, which is the gateway's limit: ask for a region of it, or for "
                       "fewer pixels"));
    }
    wire::AppendPart(std::move(*message->mutable_part()), &whole->response);
    if (is_first) {
      wire::ReserveRaw(output, limit, &whole->response);
    }
    return absl::OkStatus();
  };
  auto* const call =
      new ReadCall<v1::RenderIsosurfaceStreamRequest, v1::RenderIsosurfaceStreamResponse>(
          this, std::move(call_options), max_duration_, std::move(in_parts), append,
          [whole, done = std::move(done)](const absl::Status& status) {
            if (status.ok()) {
              done(std::move(whole->response));
            } else {
              done(status);
            }
          });
  call->Start([this](grpc::ClientContext* context, const v1::RenderIsosurfaceStreamRequest* sent,
                     grpc::ClientReadReactor<v1::RenderIsosurfaceStreamResponse>* reactor) {
    channel_->isosurface()->async()->RenderIsosurfaceStream(context, sent, reactor);
  });
}

void CoordinatorClient::Export(
    v1::ExportIsosurfaceRequest request, CallOptions call_options,
    std::function<absl::Status(const v1::ExportIsosurfaceResponse&)> visit,
    std::function<void(absl::Status)> done) {
  auto* const call = new ReadCall<v1::ExportIsosurfaceRequest, v1::ExportIsosurfaceResponse>(
      this, std::move(call_options), max_duration_, std::move(request),
      [visit = std::move(visit)](v1::ExportIsosurfaceResponse* chunk) {
        return rpc::IsSignOfLife(*chunk) ? absl::OkStatus() : visit(*chunk);
      },
      std::move(done));
  call->Start([this](grpc::ClientContext* context, const v1::ExportIsosurfaceRequest* sent,
                     grpc::ClientReadReactor<v1::ExportIsosurfaceResponse>* reactor) {
    channel_->isosurface()->async()->ExportIsosurface(context, sent, reactor);
  });
}

void CoordinatorClient::Wait(absl::Duration delay, CallOptions call_options,
                             std::function<void(absl::Status)> done) {
  Pause::Begin(std::make_shared<Pause>(&calls_, std::move(call_options.scope), std::move(done)),
               delay);
}

}  // namespace isoscope::gateway
