// The datasets that agents make together: the agents of each shard, missing shards, agents that
// contradict each other, and the messages about these. Pure functions.
//
// Content. A dataset has a name. Agents whose shards bear the same name should agree on its
// content: id, number of shards, checksums of manifest and range table. If they do not, the catalog
// takes the content that most agents have, lost ones included, as long as its shards are all
// served. It ignores the other agents. So one agent with the wrong folder does no harm, and a
// picture never mixes contents.
//
// Revision. All agents of a frame must have one picture revision. Among the revisions that serve
// all shards the one of most agents is taken, then the newest. During a rolling update frames use
// the old revision until the new one is complete and has the majority.
//
// Replicas. Shards that the same agents serve form a set. A draining agent is in the set only if no
// other agent is: it finishes its frames and gets no new ones.

#ifndef ISOSCOPE_SERVER_CLUSTER_DATASET_CATALOG_H_
#define ISOSCOPE_SERVER_CLUSTER_DATASET_CATALOG_H_

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <grpcpp/channel.h>

#include "core/frame/picture_revision.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "server/access/access_control.h"
#include "server/cluster/frame_part.h"
#include "server/cluster/series_state.h"
#include "server/cluster/served_levels.h"

namespace isoscope::server {

// One agent as it was last seen.
struct AgentState {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  std::shared_ptr<grpc::Channel> export_channel;  // null: `channel`
  // OK if the agent answered. Otherwise the reason for the failure, or the error in its answer.
  absl::Status status = absl::UnavailableError("not asked yet");
  std::string version;
  std::string renderer;
  frame::PictureRevision picture_revision;
  std::optional<isoscope::v1::AgentLoad> load;  // of its last answer; none from older versions
  bool is_draining = false;                     // it stops soon, and serves until then
  // Set while the agent opens its shards; then `status` is UNAVAILABLE.
  std::optional<isoscope::v1::OpeningProgress> opening;
  std::set<std::string> opening_datasets;  // whose shards it opens
  std::vector<isoscope::v1::DamagedShard> damaged_shards;
  // The shards of its last answer, also after the agent was lost.
  std::vector<isoscope::internal::v1::ShardDescription> shards;
};

// One dataset of the cluster.
struct DatasetState {
  isoscope::v1::Dataset dataset;  // with missing_shards
  // OK if frames can be rendered. FAILED_PRECONDITION names the missing or contradicting part.
  absl::Status status;
  // The sets have each shard once, and stand in order of their first shards. If `status` is not OK
  // they have the shards that can still be drawn together, perhaps none.
  std::vector<ReplicaSet> replica_sets;
  // The levels beside level 0, ascending. Of a series: those of the volume that Select has chosen.
  std::vector<ServedLevel> levels;
  frame::PictureRevision picture_revision;  // of all of these agents
  bool is_served = false;                   // at least one shard is
  std::string contradiction;  // if agents contradict each other: who, with which content
  // Null: a dataset without fields. If set, replica_sets are those of the series: SelectVolume
  // returns those of a volume.
  std::shared_ptr<const SeriesState> series;
};

// Removes agents from the sets, and sets that have no other agent.
void RemoveAgents(const std::set<std::string>& addresses, std::vector<ReplicaSet>* sets);

// Puts an agent's answer, or the error instead of one, into its state.
void AdoptAnswer(absl::StatusOr<isoscope::internal::v1::DescribeShardsResponse> answer,
                 AgentState* agent);

// Returns the datasets by name. `agents`: in ascending order of address.
std::map<std::string, DatasetState> DatasetsOf(const std::vector<AgentState>& agents);

// Returns "agents that can't be reached: a:1 (why), b:1 (why)", or "" if all can be reached. Agents
// that open their shards are named as such.
std::string DescribeUnreachable(const std::vector<AgentState>& agents);

// Returns the names of the datasets whose shards agents are opening.
std::set<std::string> OpeningDatasets(const std::vector<AgentState>& agents);

// Returns the datasets that the caller may see.
std::map<std::string, DatasetState> DatasetsFor(
    const Caller& caller, const std::map<std::string, DatasetState>& datasets);

// Finds the dataset of that name ("": the only one) among those that the caller may see. The result
// points into `datasets`. Copies nothing. NOT_FOUND, INVALID_ARGUMENT, or FAILED_PRECONDITION as
// DatasetService says, with the names of all of these and `unreachable`. UNAVAILABLE if it is one
// of `opening`, or if no dataset is known and the caller may see one of these.
absl::StatusOr<const DatasetState*> FindDataset(const std::map<std::string, DatasetState>& datasets,
                                                const std::string& name,
                                                const std::string& unreachable,
                                                const Caller& caller = {},
                                                const std::set<std::string>& opening = {});

// FAILED_PRECONDITION with both ids if a request expects another dataset under this name.
// `expected`: Dataset.dataset_id, or "": any.
absl::Status CheckDatasetId(const isoscope::v1::Dataset& dataset, absl::string_view expected);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_DATASET_CATALOG_H_
