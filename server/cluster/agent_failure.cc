#include "server/cluster/agent_failure.h"

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

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

absl::Status AgentFailure::ToStatus() const {
  absl::Status named(status.code(),
                     absl::StrCat(NameOf(agent), absl::IsUnavailable(status) ? " was lost: " : ": ",
                                  status.message()));
  // The agent's reason and retry delay.
  status.ForEachPayload(
      [&](absl::string_view url, const absl::Cord& payload) { named.SetPayload(url, payload); });
  return named;
}

}  // namespace isoscope::server
