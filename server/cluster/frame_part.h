// The agents of a dataset as a frame sees them: the shards that each serves, and those that each
// works on.

#ifndef ISOSCOPE_SERVER_CLUSTER_FRAME_PART_H_
#define ISOSCOPE_SERVER_CLUSTER_FRAME_PART_H_

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "server/cluster/agent_failure.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace isoscope::server {

// An agent that answers.
struct ServingAgent {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  std::shared_ptr<grpc::Channel> export_channel = nullptr;  // null: `channel`
};

// Shards, and the agents of which each serves all of them.
struct ReplicaSet {
  std::vector<int> shard_indices;    // ascending
  std::vector<ServingAgent> agents;  // by address; at least one
};

// An agent, and the shards that it works on.
struct AgentAssignment {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  std::vector<int> shard_indices;  // ascending

  [[nodiscard]] AgentIdentity identity() const { return {address, shard_indices}; }
};

// Shards that one agent works on in a frame or another request, and the agents that can.
struct FramePart {
  std::vector<int> shard_indices;      // ascending
  std::vector<ServingAgent> replicas;  // at least one; each serves all of the shards; best first

  [[nodiscard]] AgentAssignment On(std::size_t replica) const {
    return {replicas[replica].address, replicas[replica].channel, shard_indices};
  }
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_FRAME_PART_H_
