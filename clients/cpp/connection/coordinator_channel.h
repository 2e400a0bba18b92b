// The common layer of the two clients of a coordinator: ServiceClient, whose calls block, and the
// web gateway's CoordinatorClient, whose calls never do. It holds their stubs, and sets up their
// calls. It exposes gRPC, so only the sources of those two include it.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_COORDINATOR_CHANNEL_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_COORDINATOR_CHANNEL_H_

#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/trace_context.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"

namespace isoscope::client {

// Thread-safe.
class CoordinatorChannel {
 public:
  // `address`: for messages; "" for an in-process channel. `token`: for calls without a token of
  // their own; empty: none.
  CoordinatorChannel(std::shared_ptr<grpc::Channel> channel, std::string address,
                     std::string token);

  [[nodiscard]] isoscope::v1::IsosurfaceService::Stub* isosurface() const {
    return isosurface_.get();
  }
  [[nodiscard]] isoscope::v1::DatasetService::Stub* dataset() const { return dataset_.get(); }
  [[nodiscard]] isoscope::v1::ClusterService::Stub* cluster() const { return cluster_.get(); }
  [[nodiscard]] isoscope::v1::InteractService::Stub* interact() const { return interact_.get(); }
  [[nodiscard]] const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  [[nodiscard]] const std::string& address() const { return address_; }
  [[nodiscard]] const std::string& token() const { return token_; }

  // Returns the error of a call without an answer: UNAVAILABLE that names the address, and ends in
  // `advice`. Other errors, and all errors of an in-process channel, are returned unchanged.
  [[nodiscard]] absl::Status NameAddress(const absl::Status& status,
                                         absl::string_view advice = "") const;

 private:
  const std::shared_ptr<grpc::Channel> channel_;
  const std::string address_;
  const std::string token_;
  const std::unique_ptr<isoscope::v1::IsosurfaceService::Stub> isosurface_;
  const std::unique_ptr<isoscope::v1::DatasetService::Stub> dataset_;
  const std::unique_ptr<isoscope::v1::ClusterService::Stub> cluster_;
  const std::unique_ptr<isoscope::v1::InteractService::Stub> interact_;
};

// Options of one call.
struct CallSetup {
  std::string token = {};                                                // empty: the channel's own
  base::MonotonicTime deadline = base::MonotonicTime::InfiniteFuture();  // infinite: none
  const base::TraceContext* identity = nullptr;      // the trace of the call; null: none
  const base::Cancellation* cancellation = nullptr;  // outlives the call; null: none
};

// The context of one call. A cancellation ends the call with CANCELLED.
class CallContext {
 public:
  CallContext(const CoordinatorChannel& channel, const CallSetup& setup);
  CallContext(const CallContext&) = delete;
  CallContext& operator=(const CallContext&) = delete;

  grpc::ClientContext* get() { return &context_; }

 private:
  grpc::ClientContext context_;
  std::optional<base::Cancellation::Callback> on_cancel_;  // ends before the context
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_COORDINATOR_CHANNEL_H_
