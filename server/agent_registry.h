// Which agents there are, what they serve, and which datasets are complete.
//
// Every agent is asked at start, then every poll interval, and at once when a frame needs a dataset
// that is not complete or follows the loss of an agent.

#ifndef ISOSCOPE_SERVER_AGENT_REGISTRY_H_
#define ISOSCOPE_SERVER_AGENT_REGISTRY_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>

#include "core/frame/picture_revision.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "server/agent_client.h"
#include "server/coordinator_server.h"

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

// What the agents make together, by dataset name. A pure function; `agents` by address: of several
// agents that serve the same shard the first one is taken.
std::map<std::string, DatasetState> DatasetsOf(const std::vector<AgentState>& agents);

// "host:port" behind "dns:///host:port"; INVALID_ARGUMENT if that is malformed. Other targets have
// no host to be resolved here: none.
struct DnsName {
  std::string host;
  std::string port;
};
absl::StatusOr<bool> ParseDnsTarget(const std::string& target, DnsName* name);
// All addresses behind a name, as gRPC dials them, ascending. UNAVAILABLE. Blocks.
absl::StatusOr<std::vector<std::string>> ResolveAddresses(const DnsName& name);

struct AgentRegistryOptions {
  std::vector<AgentEndpoint> endpoints;  // at least one
  absl::Duration poll_interval = absl::Seconds(2);
  // Called on the registry's thread whenever it changes whether any dataset is complete.
  std::function<void(bool is_any_complete)> on_readiness;
  // Replaces ResolveAddresses in tests.
  std::function<absl::StatusOr<std::vector<std::string>>(const DnsName&)> resolve;
};

// Thread-safe.
class AgentRegistry {
 public:
  // How long an agent may take to answer, and how long a frame waits for such answers.
  static constexpr absl::Duration kProbeTimeout = absl::Seconds(1);
  static constexpr absl::Duration kMaxFrameWait = absl::Seconds(2);

  // INVALID_ARGUMENT: no endpoint, two with one target, or a malformed target.
  static absl::StatusOr<std::unique_ptr<AgentRegistry>> Start(const AgentRegistryOptions& options);
  ~AgentRegistry();

  AgentRegistry(const AgentRegistry&) = delete;
  AgentRegistry& operator=(const AgentRegistry&) = delete;

  // The dataset of that name ("": the only one), complete. Asks the agents again, for kMaxFrameWait
  // or until `deadline`, if it is not complete or an agent was lost since the last poll.
  // NOT_FOUND, INVALID_ARGUMENT, FAILED_PRECONDITION as IsosurfaceService says. May block.
  absl::StatusOr<DatasetState> FindComplete(const std::string& name, absl::Time deadline);
  // The dataset as it was last seen, complete or not. NOT_FOUND, INVALID_ARGUMENT as DatasetService
  // says. Does not block.
  absl::StatusOr<DatasetState> Find(const std::string& name) const;
  // A call to the agent failed: it is asked again before the next frame.
  void ReportFailure(const std::string& address);

  // By address.
  [[nodiscard]] std::vector<AgentState> agents() const;
  // By name.
  [[nodiscard]] std::map<std::string, DatasetState> datasets() const;

  // As CoordinatorServer::WaitUntilReady.
  absl::Status WaitUntilReady(absl::Time deadline);

 private:
  // An agent's address and how it came to be known.
  struct Link {
    AgentState state;
    std::size_t endpoint_index = 0;
    bool is_listed = true;    // the name still stands for this address
    bool is_suspect = false;  // failed since it was last asked
    bool has_fixed_channel = false;
  };

  explicit AgentRegistry(AgentRegistryOptions options);
  void Run();
  void Probe();
  // What to ask: links by address, resolved anew. Blocks on the resolver.
  std::map<std::string, Link> ResolveLinks(std::map<std::string, Link> links) const;
  void AdoptLinks(std::map<std::string, Link> links) ABSL_LOCKS_EXCLUDED(mutex_);
  // Asks for a probe that begins after now and waits for its end, at most until `deadline`.
  void ProbeNow(absl::Time deadline) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<DatasetState> FindLocked(const std::string& name) const
      ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  [[nodiscard]] std::string UnreachableAgents() const ABSL_SHARED_LOCKS_REQUIRED(mutex_);

  const AgentRegistryOptions options_;
  mutable absl::Mutex mutex_;
  std::map<std::string, Link> links_ ABSL_GUARDED_BY(mutex_);  // by address
  std::map<std::string, DatasetState> datasets_ ABSL_GUARDED_BY(mutex_);
  bool is_any_complete_ ABSL_GUARDED_BY(mutex_) = false;
  std::int64_t wanted_probe_ ABSL_GUARDED_BY(mutex_) = 1;    // number of the last one asked for
  std::int64_t started_probe_ ABSL_GUARDED_BY(mutex_) = 0;   // of the last one begun
  std::int64_t finished_probe_ ABSL_GUARDED_BY(mutex_) = 0;  // of the last one ended
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_AGENT_REGISTRY_H_
