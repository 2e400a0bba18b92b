#include "server/cluster/agent_failure.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/error_reason.h"

namespace isoscope::server {

std::string NameOf(const AgentIdentity& agent) {
  return absl::StrCat("agent ", agent.address,
                      agent.shard_indices.size() == 1 ? " (shard " : " (shards ",
                      absl::StrJoin(agent.shard_indices, ", "), ")");
}

const char* NameOf(PartStage stage) {
  switch (stage) {
    case PartStage::kSelectingOccluders:
      return "selecting occluders";
    case PartStage::kRenderingOccluders:
      return "rendering occluders";
    case PartStage::kRenderingVisible:
      return "rendering visible blocks";
    case PartStage::kDone:
      return "done";
    case PartStage::kEnded:
      return "ended";
    case PartStage::kExtracting:
      return "extracting the surface";
    case PartStage::kAnswering:
      return "answering a question";
  }
  return "";
}

bool AgentFailure::IsLost() const {
  return absl::IsUnavailable(status) &&
         base::ReasonOf(status) != base::ErrorReason::kSourceUnreadable;
}

absl::Status AgentFailure::ToStatus() const {
  return base::WithPrefix(absl::StrCat(NameOf(agent), IsLost() ? " was lost: " : ": "), status);
}

}  // namespace isoscope::server
