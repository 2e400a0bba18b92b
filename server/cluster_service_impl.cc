// GetCapabilities and GetClusterStatus answer at once, from memory. They ask no agent.
//
// The state of an agent is the first that applies:
//
//   OPENING       it answers, and its shards are not open yet
//   UNREACHABLE   the last probe failed; the message says why
//   REACHABLE     the message is the complaint about one of its datasets, or empty
//
// A caller sees the shards, damages and frames of the datasets that it may see. A named caller does
// not see the addresses of other clients.

#include "server/cluster_service_impl.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>

#include "absl/status/status.h"

#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "server/call/public_call.h"
#include "server/page.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

// Returns the error of an agent that answers: one of its datasets contradicts those of other
// agents.
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

// Leaves out the datasets that the caller may not see; they are not in `datasets`.
isoscope::v1::AgentStatus ToProto(const AgentState& agent, const Caller& caller,
                                  const std::map<std::string, DatasetState>& datasets) {
  isoscope::v1::AgentStatus proto;
  proto.set_address(agent.address);
  proto.set_version(agent.version);
  proto.set_renderer(agent.renderer);
  if (agent.opening.has_value()) {
    proto.set_state(isoscope::v1::AgentStatus::STATE_OPENING);
    proto.set_message(std::string(agent.status.message()));
    *proto.mutable_opening() = *agent.opening;
    proto.set_picture_revision(frame::ToString(agent.picture_revision));
    if (agent.load.has_value()) {
      *proto.mutable_load() = *agent.load;
    }
    return proto;
  }
  if (!agent.status.ok()) {
    proto.set_state(isoscope::v1::AgentStatus::STATE_UNREACHABLE);
    proto.set_message(std::string(agent.status.message()));
    return proto;
  }
  proto.set_state(isoscope::v1::AgentStatus::STATE_REACHABLE);
  proto.set_is_draining(agent.is_draining);
  proto.set_picture_revision(frame::ToString(agent.picture_revision));
  proto.set_message(Complaint(agent, datasets));
  if (agent.load.has_value()) {
    *proto.mutable_load() = *agent.load;
  }
  for (const isoscope::v1::DamagedShard& damaged : agent.damaged_shards) {
    if (caller.MaySee(damaged.dataset())) {
      *proto.add_damaged_shards() = damaged;
    }
  }
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

isoscope::v1::FrameInWork::Step ToProto(FramePhase phase) {
  using Proto = isoscope::v1::FrameInWork;
  switch (phase) {
    case FramePhase::kQueued:
      return Proto::STEP_QUEUED;
    case FramePhase::kPreparing:
      return Proto::STEP_PREPARING;
    case FramePhase::kOccluderSelection:
      return Proto::STEP_OCCLUDER_SELECTION;
    case FramePhase::kOccluderRendering:
      return Proto::STEP_OCCLUDER_RENDERING;
    case FramePhase::kVisibilityCulling:
      return Proto::STEP_VISIBILITY_CULLING;
    case FramePhase::kFinishing:
      return Proto::STEP_FINISHING;
  }
  return Proto::STEP_UNSPECIFIED;
}

isoscope::v1::FrameInWork ToProto(const FrameBoard::Frame& frame, base::MonotonicTime now) {
  isoscope::v1::FrameInWork proto;
  proto.set_request_id(frame.note.request_id);
  proto.set_client(frame.note.client.text());
  proto.set_dataset(frame.note.dataset.text());
  proto.mutable_extent()->set_width_px(frame.note.width_px);
  proto.mutable_extent()->set_height_px(frame.note.height_px);
  proto.set_step(ToProto(frame.phase));
  *proto.mutable_age_duration() =
      wire::ToProto(std::max(now - frame.note.arrival, absl::ZeroDuration()));
  return proto;
}

isoscope::v1::CoordinatorLoad LoadOf(const CoordinatorState& state, absl::Duration up) {
  const CoordinatorState::FrameCounts frames = state.CountFrames();
  const FrameMetrics& metrics = state.frame_metrics;
  isoscope::v1::CoordinatorLoad load;
  *load.mutable_up_duration() = wire::ToProto(up);
  load.set_working_frame_count(frames.working);
  load.set_queued_frame_count(frames.queued);
  load.set_done_frame_count(metrics.done.value());
  load.set_failed_frame_count(metrics.failed.value() + metrics.cancelled.value());
  load.set_refused_frame_count(metrics.refused.value());
  load.set_network_bytes(metrics.network_bytes.value());
  load.set_resident_bytes(static_cast<std::int64_t>(base::ResidentBytes()));
  load.set_memory_limit_bytes(static_cast<std::int64_t>(state.memory.limit_bytes()));
  return load;
}

}  // namespace

grpc::ServerUnaryReactor* ClusterServiceImpl::GetCapabilities(
    grpc::CallbackServerContext* context, const isoscope::v1::GetCapabilitiesRequest* request,
    isoscope::v1::GetCapabilitiesResponse* response) {
  const auto answer = [&](PublicCall* call) -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(state_.calls.access->CheckCapabilities(call->peer()));
    const base::MutexLock lock(&mutex_);
    *response = capabilities_;
    return absl::OkStatus();
  };
  return AnswerAtOnce(&state_.calls, RequestMethod::kGetCapabilities, context, *request, "",
                      answer);
}

void ClusterServiceImpl::SetGatewayAddress(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  capabilities_.set_gateway_address(address);
}

grpc::ServerUnaryReactor* ClusterServiceImpl::GetClusterStatus(
    grpc::CallbackServerContext* context, const isoscope::v1::GetClusterStatusRequest* request,
    isoscope::v1::GetClusterStatusResponse* response) {
  const auto answer = [&](PublicCall* call) -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(call->Identify());
    const Caller& caller = call->caller();
    const std::map<std::string, DatasetState> datasets = state_.registry->datasets(caller);
    ISOSCOPE_ASSIGN_OR_RETURN(Page page,
                              Page::Make("agents", request->page_size(), request->page_token()));
    for (const AgentState& agent : state_.registry->agents()) {
      if (page.Offer(agent.address)) {
        *response->add_agents() = ToProto(agent, caller, datasets);
      }
    }
    response->set_next_page_token(page.next_token());
    const base::MonotonicTime now = base::MonotonicNow();
    *response->mutable_load() = LoadOf(state_, now - start_);
    for (const FrameBoard::Frame& frame : state_.board.Frames()) {
      if (caller.MaySee(frame.note.dataset.text())) {
        isoscope::v1::FrameInWork& added = *response->add_frames();
        added = ToProto(frame, now);
        if (!caller.name().empty()) {
          added.clear_client();  // addresses of other users' clients are private
        }
      }
    }
    return absl::OkStatus();
  };
  return AnswerAtOnce(&state_.calls, RequestMethod::kGetClusterStatus, context, *request, "",
                      answer);
}

}  // namespace isoscope::server
