// ClusterService: the limits, and the agents as the registry last saw them.

#ifndef ISOSCOPE_SERVER_CLUSTER_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_CLUSTER_SERVICE_IMPL_H_

#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "server/frame/coordinator_state.h"

namespace isoscope::server {

// Thread-safe.
class ClusterServiceImpl final : public isoscope::v1::ClusterService::CallbackService {
 public:
  // The state outlives the service.
  ClusterServiceImpl(CoordinatorState* state, isoscope::v1::GetCapabilitiesResponse capabilities)
      : state_(*state), capabilities_(std::move(capabilities)) {}

  grpc::ServerUnaryReactor* GetCapabilities(
      grpc::CallbackServerContext* context, const isoscope::v1::GetCapabilitiesRequest* request,
      isoscope::v1::GetCapabilitiesResponse* response) override;
  grpc::ServerUnaryReactor* GetClusterStatus(
      grpc::CallbackServerContext* context, const isoscope::v1::GetClusterStatusRequest* request,
      isoscope::v1::GetClusterStatusResponse* response) override;

  // Names the web gateway from now on. Thread-safe.
  void SetGatewayAddress(const std::string& address) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  CoordinatorState& state_;
  const base::MonotonicTime start_ = base::MonotonicNow();
  base::Mutex mutex_;
  isoscope::v1::GetCapabilitiesResponse capabilities_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_SERVICE_IMPL_H_
