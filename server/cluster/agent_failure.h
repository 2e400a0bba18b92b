// An agent that failed in a frame, as data. The caller can report it, or repeat the agent's part
// elsewhere, because parts are idempotent.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_FAILURE_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_FAILURE_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace isoscope::server {

// An agent, and the shards that it works on.
struct AgentIdentity {
  std::string address;
  std::vector<int> shard_indices;  // ascending

  friend bool operator==(const AgentIdentity&, const AgentIdentity&) = default;
};

// "agent 10.0.0.7:50052 (shards 3, 7)".
std::string NameOf(const AgentIdentity& agent);

// The stages of an agent's part of a frame, in order; then what an agent does for other requests.
enum class PartStage {
  kSelectingOccluders,  // step 1
  kRenderingOccluders,  // step 2
  kRenderingVisible,    // step 3; the whole frame with Culling::kNone
  kDone,                // it has said so
  kEnded,               // its stream has ended
  kExtracting,          // no frame: the surface of an export
  kAnswering,           // no frame: a question, such as a histogram or the points of a pick
};
inline constexpr std::size_t kPartStageCount = static_cast<std::size_t>(PartStage::kAnswering) + 1;

// "selecting occluders", ...: for messages and logs.
const char* NameOf(PartStage stage);

struct AgentFailure {
  std::size_t part_index = 0;  // among the frame's parts
  AgentIdentity agent;
  PartStage stage = PartStage::kSelectingOccluders;
  // UNAVAILABLE: the agent, the way to it, or that to a source was lost. DEADLINE_EXCEEDED: it had not answered.
  // DATA_LOSS: it sent or read damaged bytes. Otherwise its own error. Does not name the agent.
  absl::Status status;

  // UNAVAILABLE, but for that of a source that the agent asked.
  [[nodiscard]] bool IsLost() const;
  // Returns the status for clients, which names agent and shards.
  [[nodiscard]] absl::Status ToStatus() const;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_FAILURE_H_
