#include "server/cluster/agent_failure.h"

#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"

#include "core/base/retry_delay.h"

namespace isoscope::server {

std::string NameOf(const AgentIdentity& agent) {
  return absl::StrCat("agent ", agent.address,
                      agent.shard_indices.size() == 1 ? " (shard " : " (shards ",
                      absl::StrJoin(agent.shard_indices, ", "), ")");
}

const char* NameOf(FrameStage stage) {
  switch (stage) {
    case FrameStage::kSelectingOccluders:
      return "selecting occluders";
    case FrameStage::kRenderingOccluders:
      return "rendering occluders";
    case FrameStage::kRenderingVisible:
      return "rendering visible blocks";
    case FrameStage::kDone:
      return "done";
    case FrameStage::kEnded:
      return "ended";
  }
  return "";
}

absl::Status AgentFailure::ToStatus() const {
  absl::Status named(status.code(),
                     absl::StrCat(NameOf(agent), absl::IsUnavailable(status) ? " was lost: " : ": ",
                                  status.message()));
  const std::optional<absl::Duration> delay = base::RetryDelayOf(status);
  return delay.has_value() ? base::WithRetryDelay(std::move(named), *delay) : named;
}

}  // namespace isoscope::server
