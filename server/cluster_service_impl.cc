#include "server/cluster_service_impl.h"

#include <map>
#include <set>
#include <string>

#include "absl/status/status.h"

#include "core/base/status_macros.h"
#include "core/rpc/peer.h"
#include "core/rpc/unary_call.h"

namespace isoscope::server {
namespace {

// Returns the error of an agent that answers: that of one of its datasets that contradicts others.
std::string Complaint(const AgentState& agent,
                      const std::map<std::string, DatasetState>& datasets) {
  std::set<std::string> complaints;
  for (const isoscope::internal::v1::ShardDescription& shard : agent.shards) {
    const auto found = datasets.find(shard.dataset().name());
    if (found != datasets.end() && !found->second.status.ok()) {
      complaints.emplace(found->second.status.message());
    }
  }
  return complaints.empty() ? "" : *complaints.begin();
}

// Without the datasets that the caller may not see; `datasets` has none of them.
isoscope::v1::AgentStatus ToProto(const AgentState& agent, const Caller& caller,
                                  const std::map<std::string, DatasetState>& datasets) {
  isoscope::v1::AgentStatus proto;
  proto.set_address(agent.address);
  proto.set_version(agent.version);
  proto.set_renderer(agent.renderer);
  if (!agent.status.ok()) {
    proto.set_state(isoscope::v1::AgentStatus::STATE_UNREACHABLE);
    proto.set_message(std::string(agent.status.message()));
    return proto;
  }
  proto.set_state(isoscope::v1::AgentStatus::STATE_REACHABLE);
  proto.set_picture_revision(frame::ToString(agent.picture_revision));
  proto.set_message(Complaint(agent, datasets));
  for (const isoscope::internal::v1::ShardDescription& shard : agent.shards) {
    if (!caller.MaySee(shard.dataset().name())) {
      continue;
    }
    isoscope::v1::ServedShard* served = proto.add_shards();
    served->set_dataset(shard.dataset().name());
    served->set_dataset_id(shard.dataset().dataset_id());
    served->set_shard_index(shard.shard_index());
    served->set_block_count(shard.block_count());
  }
  return proto;
}

}  // namespace

grpc::ServerUnaryReactor* ClusterServiceImpl::GetCapabilities(
    grpc::CallbackServerContext* context, const isoscope::v1::GetCapabilitiesRequest* request,
    isoscope::v1::GetCapabilitiesResponse* response) {
  return rpc::AnswerUnary(context, *request, [&]() -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(access_->CheckCapabilities(rpc::PeerOf(*context)));
    const base::MutexLock lock(&mutex_);
    *response = capabilities_;
    return absl::OkStatus();
  });
}

void ClusterServiceImpl::SetGatewayAddress(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  capabilities_.set_gateway_address(address);
}

grpc::ServerUnaryReactor* ClusterServiceImpl::GetClusterStatus(
    grpc::CallbackServerContext* context, const isoscope::v1::GetClusterStatusRequest* request,
    isoscope::v1::GetClusterStatusResponse* response) {
  return rpc::AnswerUnary(context, *request, [&]() -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(const Caller caller, access_->Identify(rpc::PeerOf(*context)));
    const std::map<std::string, DatasetState> datasets = registry_->datasets(caller);
    for (const AgentState& agent : registry_->agents()) {
      *response->add_agents() = ToProto(agent, caller, datasets);
    }
    return absl::OkStatus();
  });
}

}  // namespace isoscope::server
