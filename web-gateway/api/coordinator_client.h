// The coordinator's public services as calls that never block: a function is called with the
// answer, on a thread of gRPC. This header names messages without including theirs, as
// clients/cpp/connection/service_client.h does.

#ifndef ISOSCOPE_WEB_GATEWAY_API_COORDINATOR_CLIENT_H_
#define ISOSCOPE_WEB_GATEWAY_API_COORDINATOR_CLIENT_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"
#include "web-gateway/api/request_scope.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace isoscope::v1 {
class ExportIsosurfaceRequest;
class ExportIsosurfaceResponse;
class GetCapabilitiesResponse;
class GetClusterStatusResponse;
class GetDatasetRequest;
class GetDatasetResponse;
class GetHistogramRequest;
class GetHistogramResponse;
class ListDatasetsResponse;
class PickSurfaceRequest;
class PickSurfaceResponse;
class RenderIsosurfaceRequest;
class RenderIsosurfaceResponse;
}  // namespace isoscope::v1

namespace isoscope::client {
class CoordinatorChannel;
}  // namespace isoscope::client

namespace isoscope::gateway {

// Counts the calls that gRPC still holds. Thread-safe.
class CallCounter {
 public:
  void Add();
  void Remove();
  // Blocks until gRPC holds no calls.
  void AwaitNone();

 private:
  base::Mutex mutex_;
  base::CondVar none_;
  int count_ ABSL_GUARDED_BY(mutex_) = 0;
};

// Options of one call.
struct CallOptions {
  // The request that the call serves: its identity, and its cancellation. Null: none.
  std::shared_ptr<RequestScope> scope = nullptr;
  // The token of the call's user; empty: the client's own token, if it has one.
  std::string token = {};
};

struct CoordinatorClientOptions {
  std::shared_ptr<grpc::Channel> channel;
  std::string address = {};                              // for messages; empty: in this process
  std::string token = {};                                // for calls without a token; empty: none
  absl::Duration max_duration = absl::Minutes(5);        // of a picture, a pick, a mesh
  std::size_t max_picture_bytes = std::size_t{1} << 28;  // of a picture with its planes
};

// Thread-safe. Each call carries the identity of its request, and ends early with CANCELLED once
// that is cancelled. `done` is called exactly once; it must not destroy the client.
class CoordinatorClient {
 public:
  template <typename Response>
  using Done = std::function<void(absl::StatusOr<Response>)>;

  explicit CoordinatorClient(CoordinatorClientOptions options);
  // Waits until all calls have ended.
  ~CoordinatorClient();

  void GetCapabilities(CallOptions call, Done<isoscope::v1::GetCapabilitiesResponse> done);
  void GetClusterStatus(CallOptions call, Done<isoscope::v1::GetClusterStatusResponse> done);
  void ListDatasets(CallOptions call, Done<isoscope::v1::ListDatasetsResponse> done);
  void GetDataset(isoscope::v1::GetDatasetRequest request, CallOptions call,
                  Done<isoscope::v1::GetDatasetResponse> done);
  void GetHistogram(isoscope::v1::GetHistogramRequest request, CallOptions call,
                    Done<isoscope::v1::GetHistogramResponse> done);
  void PickSurface(isoscope::v1::PickSurfaceRequest request, CallOptions call,
                   Done<isoscope::v1::PickSurfaceResponse> done);
  // Calls RenderIsosurfaceStream and joins its parts. RESOURCE_EXHAUSTED above max_picture_bytes.
  void Render(isoscope::v1::RenderIsosurfaceRequest request, CallOptions call,
              Done<isoscope::v1::RenderIsosurfaceResponse> done);
  // Passes each chunk to `visit`, in order, one at a time. Its error ends the call and becomes the
  // result.
  void Export(isoscope::v1::ExportIsosurfaceRequest request, CallOptions call,
              std::function<absl::Status(const isoscope::v1::ExportIsosurfaceResponse&)> visit,
              std::function<void(absl::Status)> done);

  // Calls `done` after `delay`, or with CANCELLED once the call's request is cancelled. Counts as a
  // call.
  void Wait(absl::Duration delay, CallOptions call, std::function<void(absl::Status)> done);

  // The deadline of a picture, a pick or a mesh.
  [[nodiscard]] absl::Duration max_duration() const { return max_duration_; }

  // Waits until all calls have ended.
  void AwaitCalls() { calls_.AwaitNone(); }

  // Used by the calls themselves.
  [[nodiscard]] const client::CoordinatorChannel& channel() const { return *channel_; }
  CallCounter* calls() { return &calls_; }

 private:
  const std::unique_ptr<const client::CoordinatorChannel> channel_;
  const absl::Duration max_duration_;
  const std::size_t max_picture_bytes_;
  CallCounter calls_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_COORDINATOR_CLIENT_H_
