// One stream of InteractService.Interact, for one viewer.

#ifndef ISOSCOPE_WEB_GATEWAY_INTERACT_STREAM_H_
#define ISOSCOPE_WEB_GATEWAY_INTERACT_STREAM_H_

#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <optional>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include <grpcpp/client_context.h>
#include <grpcpp/support/client_callback.h>

#include "core/base/mutex.h"
#include "core/base/trace_context.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "web-gateway/coordinator_client.h"

namespace isoscope::gateway {

// Thread-safe. A state that was not sent yet is replaced by a newer one; frames that were shown are
// all reported, before the state.
class InteractStream final : private grpc::ClientBidiReactor<isoscope::v1::InteractRequest,
                                                             isoscope::v1::InteractResponse> {
 public:
  // Called by threads of gRPC, one at a time and in order; it must not block.
  using OnResponse = std::function<void(isoscope::v1::InteractResponse)>;
  // Called once, after the last response; OK if the coordinator ended the stream.
  using OnEnd = std::function<void(const absl::Status&)>;

  // The most reports that wait to be sent; more end the stream with INVALID_ARGUMENT.
  static constexpr std::size_t kMaxWaitingReports = 256;

  // Opens the stream at once, in the name of the viewer's request. `client` outlives it and all of
  // its calls. `token`: the user's, or empty.
  static std::shared_ptr<InteractStream> Open(CoordinatorClient* client, const std::string& token,
                                              const base::TraceContext& identity,
                                              OnResponse on_response, OnEnd on_end);

  // Queues a message. Does nothing once the stream has ended.
  void Send(isoscope::v1::InteractRequest request) ABSL_LOCKS_EXCLUDED(mutex_);
  // Ends it soon; OnEnd is still called.
  void Cancel() { context_.TryCancel(); }

 private:
  InteractStream(CoordinatorClient* client, OnResponse on_response, OnEnd on_end)
      : client_(client), on_response_(std::move(on_response)), on_end_(std::move(on_end)) {}
  ~InteractStream() override = default;

  void OnReadDone(bool ok) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnWriteDone(bool ok) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnDone(const grpc::Status& status) override ABSL_LOCKS_EXCLUDED(mutex_);
  void StartNextWrite() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  CoordinatorClient* const client_;
  OnResponse on_response_;
  OnEnd on_end_;
  std::shared_ptr<InteractStream> self_;  // until OnDone
  grpc::ClientContext context_;
  isoscope::v1::InteractResponse incoming_;

  base::Mutex mutex_;
  std::optional<isoscope::v1::InteractRequest> state_ ABSL_GUARDED_BY(mutex_);
  std::deque<isoscope::v1::InteractRequest> reports_ ABSL_GUARDED_BY(mutex_);
  isoscope::v1::InteractRequest outgoing_ ABSL_GUARDED_BY(mutex_);
  absl::Status error_ ABSL_GUARDED_BY(mutex_) = absl::OkStatus();
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool reads_have_ended_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_INTERACT_STREAM_H_
