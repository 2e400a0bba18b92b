#include "clients/cpp/connection/coordinator_channel.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/monotonic_time.h"
#include "rpc/grpc_time.h"
#include "rpc/peer.h"
#include "rpc/request_context.h"

namespace isoscope::client {

namespace v1 = isoscope::v1;

CoordinatorChannel::CoordinatorChannel(std::shared_ptr<grpc::Channel> channel, std::string address,
                                       std::string token)
    : channel_(std::move(channel)),
      address_(std::move(address)),
      token_(std::move(token)),
      isosurface_(v1::IsosurfaceService::NewStub(channel_)),
      dataset_(v1::DatasetService::NewStub(channel_)),
      cluster_(v1::ClusterService::NewStub(channel_)),
      interact_(v1::InteractService::NewStub(channel_)) {}

absl::Status CoordinatorChannel::NameAddress(const absl::Status& status,
                                             absl::string_view advice) const {
  if (absl::IsUnavailable(status) && !address_.empty() &&
      channel_->GetState(/*try_to_connect=*/false) != GRPC_CHANNEL_READY) {
    return absl::UnavailableError(
        absl::StrCat("no coordinator answers at ", address_, " (", status.message(), ")", advice));
  }
  return status;
}

CallContext::CallContext(const CoordinatorChannel& channel, const CallSetup& setup) {
  rpc::SendToken(setup.token.empty() ? channel.token() : setup.token, &context_);
  if (setup.deadline < base::MonotonicTime::InfiniteFuture()) {
    context_.set_deadline(setup.deadline);
  }
  if (setup.identity != nullptr) {
    rpc::SetTraceparent(*setup.identity, &context_);
  }
  if (setup.cancellation != nullptr) {
    on_cancel_.emplace(*setup.cancellation, [this] { context_.TryCancel(); });
  }
}

}  // namespace isoscope::client
