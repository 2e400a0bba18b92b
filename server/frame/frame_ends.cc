// A call that begins a frame without blocks to draw is the message: a `begin` without shards and
// frame. Its link must be destroyed by a thread that is not gRPC's (agent_client.cc). So calls that
// have ended stay until the next ones are made.

#include "server/frame/frame_ends.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "server/frame/agent_client.h"
#include "server/frame/agent_link.h"

namespace isoscope::server {

void FollowingCalls::Note(const AgentAssignment& agent, bool others_follow) {
  if (others_follow) {
    waiting_.insert_or_assign(agent.address, agent);
  } else {
    waiting_.erase(agent.address);
  }
}

std::vector<AgentAssignment> FollowingCalls::TakeWaiting() {
  std::vector<AgentAssignment> agents;
  for (auto& [address, agent] : std::exchange(waiting_, {})) {
    agents.push_back(std::move(agent));
  }
  return agents;
}

class FrameEnds::Call final : public AgentListener {
 public:
  explicit Call(FrameEnds* owner) : owner_(*owner) {}

  void OnRayHits(std::vector<volume::BlockId> /*hits*/,
                 std::vector<volume::BlockId> /*active*/) override {}
  void OnPixels(std::vector<std::string> /*bands*/) override {}
  void OnDrawnPixels(image::DrawnPixels /*pixels*/) override {}
  void OnOccludersDone() override {}
  void OnFrameDone(frame::AgentStatistics /*statistics*/) override {}
  void OnEnd(absl::Status /*status*/) override {
    const base::MutexLock lock(&owner_.mutex_);
    has_ended = true;
    owner_.ended_.SignalAll();
  }

  bool has_ended = false;  // guarded by the owner's mutex
  std::unique_ptr<AgentLink> link;

 private:
  FrameEnds& owner_;
};

FrameEnds::FrameEnds() = default;

FrameEnds::~FrameEnds() {
  Calls calls;
  {
    const base::MutexLock lock(&mutex_);
    ended_.Await(&mutex_, [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return std::all_of(calls_.begin(), calls_.end(),
                         [](const std::unique_ptr<Call>& call) { return call->has_ended; });
    });
    calls.swap(calls_);
  }
  // The links wait for the rest of OnEnd.
}

void FrameEnds::Tell(FollowingCalls* calls, const base::TraceContext& request,
                     std::int64_t frame_number) {
  // Without memory agents give up by themselves.
  base::OrNoMemory("the end of a frame", [&] {
    for (const AgentAssignment& agent : calls->TakeWaiting()) {
      Tell(agent, request, frame_number);
    }
    return absl::OkStatus();
  }).IgnoreError();
}

void FrameEnds::Tell(const AgentAssignment& agent, const base::TraceContext& request,
                     std::int64_t frame_number) {
  Calls over;
  {
    const base::MutexLock lock(&mutex_);
    for (auto call = calls_.begin(); call != calls_.end();) {
      const auto ended = call++;
      if ((*ended)->has_ended) {
        over.splice(over.end(), calls_, ended);
      }
    }
    if (calls_.size() >= kMaxCalls) {
      return;
    }
  }
  base::LogDebug(
      "no_call_follows",
      {{"request", request.request_id()}, {"frame", frame_number}, {"agent", agent.address}});
  isoscope::internal::v1::BeginFrame end;
  end.set_frame_number(frame_number);
  Calls calls;
  calls.push_back(std::make_unique<Call>(this));
  calls.back()->link =
      BeginFrameOnAgent({agent.address, agent.channel, /*shard_indices=*/{}}, std::move(end),
                        /*block_count=*/0, base::MonotonicNow() + kMaxDuration,
                        /*mailboxes=*/nullptr, request, /*trace_target=*/{}, calls.back().get());
  const base::MutexLock lock(&mutex_);
  calls_.splice(calls_.end(), calls);
}

}  // namespace isoscope::server
