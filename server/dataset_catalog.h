// The datasets that agents make together: who serves which shards, whether all shards of a dataset
// are there, whether agents contradict each other, and the sentences that say so. Pure functions.
//
// A dataset has a name. Agents whose shards bear the same name must agree on its identity: id,
// number of shards, checksums of manifest and range table. For each name, the first reachable agent
// by address is the reference that others must agree with. Of several agents that serve the same
// shard, the first by address works on it. All that work on a dataset must have one picture
// revision.

#ifndef ISOSCOPE_SERVER_DATASET_CATALOG_H_
#define ISOSCOPE_SERVER_DATASET_CATALOG_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include <grpcpp/channel.h>

#include "core/frame/picture_revision.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "server/agent_client.h"

namespace isoscope::server {

// One agent as it was last seen.
struct AgentState {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  // OK: it answered. Else why it did not; or what is wrong with what it said.
  absl::Status status = absl::UnavailableError("not asked yet");
  std::string version;
  std::string renderer;
  frame::PictureRevision picture_revision;
  // What it serves; of an agent that does not answer: what it served when it last did.
  std::vector<isoscope::internal::v1::ShardDescription> shards;
};

// One dataset of the cluster.
struct DatasetState {
  isoscope::v1::Dataset dataset;  // with missing_shards
  // OK: frames can be rendered. FAILED_PRECONDITION: says what is missing or contradictory.
  absl::Status status;
  // Each shard once, in order of the agents' first shards. Only if `status` is OK.
  std::vector<AgentAssignment> agents;
  frame::PictureRevision picture_revision;  // of all of these agents
  bool is_served = false;                   // at least one shard is
};

// Takes an agent's answer, or the error instead of one, into its state.
void AdoptAnswer(absl::StatusOr<isoscope::internal::v1::DescribeShardsResponse> answer,
                 AgentState* agent);

// By name. `agents`: by address.
std::map<std::string, DatasetState> DatasetsOf(const std::vector<AgentState>& agents);

// "agents that can't be reached: a:1 (why), b:1 (why)"; empty if all can.
std::string DescribeUnreachable(const std::vector<AgentState>& agents);

// The dataset of that name ("": the only one). NOT_FOUND, INVALID_ARGUMENT and FAILED_PRECONDITION
// as DatasetService says, with the names that there are and with `unreachable`.
absl::StatusOr<DatasetState> FindDataset(const std::map<std::string, DatasetState>& datasets,
                                         const std::string& name, const std::string& unreachable);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_DATASET_CATALOG_H_
