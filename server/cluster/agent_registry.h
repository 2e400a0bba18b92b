// The members of the cluster: its agents. The registry resolves their addresses, has them asked,
// and keeps their answers and the datasets that they make together.
//
// It asks every agent at start, then at every poll interval. It asks at once when a frame needs an
// incomplete dataset, or follows the loss of an agent.
//
// The findings are an immutable snapshot: each probe makes a new one. A frame holds the snapshot
// that it began with, and copies nothing of it.
//
// Other files have the other parts of this work: agent_members finds addresses, agent_prober asks,
// dataset_catalog combines the answers.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_REGISTRY_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_REGISTRY_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "rpc/transport.h"
#include "server/access/access_control.h"
#include "server/cluster/agent_endpoint.h"
#include "server/cluster/agent_members.h"
#include "server/cluster/agent_prober.h"
#include "server/cluster/dataset_catalog.h"
#include "server/cluster/dns_target.h"

namespace isoscope::server {

struct AgentRegistryOptions {
  std::vector<AgentEndpoint> endpoints;  // at least one
  absl::Duration poll_interval = absl::Seconds(2);
  // The way to dial agents. Agents behind a DNS name must have certificates of that name, unless
  // `dialing` has one name for all.
  rpc::Dialing dialing = {};
  // Checks a target of a list (agent_list). An error refuses the whole list. Null: all are allowed.
  std::function<absl::Status(const std::string& target)> check_target;
  // Called on the registry's thread, once, when all agents have answered or failed.
  std::function<void()> on_first_probe;
  // Tests replace these. The registry's thread calls both, and they may block. `cancellation` fires
  // when the registry is destroyed.
  std::function<absl::StatusOr<std::vector<std::string>>(const DnsName&)> resolve =
      ResolveAddresses;
  std::function<void(absl::Span<AgentProbe> probes, const base::Cancellation& cancellation)> probe =
      ProbeAgents;
};

// Thread-safe.
class AgentRegistry {
 public:
  // The longest time that a frame waits for the answers of agents.
  static constexpr absl::Duration kMaxFrameWait = absl::Seconds(2);
  // If no agent serves a name, the agents are asked for it at most once in this time. Until then
  // the error is NOT_FOUND.
  static constexpr absl::Duration kMissingNameInterval = absl::Seconds(1);

  // INVALID_ARGUMENT: no endpoint, two with one target, or a malformed target.
  static absl::StatusOr<std::unique_ptr<AgentRegistry>> Start(const AgentRegistryOptions& options);
  ~AgentRegistry();

  AgentRegistry(const AgentRegistry&) = delete;
  AgentRegistry& operator=(const AgentRegistry&) = delete;

  // Returns the complete dataset of that name ("": the only one) among those that the caller may
  // see. Agents that were lost since the last probe are not among its replicas, and are asked
  // again. If it is not complete without them, waits for the answers, at most for kMaxFrameWait or
  // until the deadline of `cancellation`. NOT_FOUND, INVALID_ARGUMENT, FAILED_PRECONDITION as
  // IsosurfaceService says; CANCELLED at once when the cancellation fires. May block.
  //
  // With `allow_partial` some shards may be missing, and a lost agent is waited for only once.
  absl::StatusOr<std::shared_ptr<const DatasetState>> FindComplete(
      const std::string& name, const base::Cancellation& cancellation, const Caller& caller = {},
      bool allow_partial = false);
  // Returns the dataset as it was last seen, complete or not. NOT_FOUND, INVALID_ARGUMENT as
  // DatasetService says. Does not block.
  absl::StatusOr<std::shared_ptr<const DatasetState>> Find(const std::string& name,
                                                           const Caller& caller = {}) const;
  // Reports that a call to the agent failed. The agent is asked again before its next frame.
  void ReportFailure(const std::string& address);
  // Returns false if the agent did not answer when it was last asked, or is gone.
  [[nodiscard]] bool IsReachable(const std::string& address) const;

  // Returns the agents, ordered by address.
  [[nodiscard]] std::vector<AgentState> agents() const;
  // Returns the datasets that the caller may see, by name.
  [[nodiscard]] std::map<std::string, DatasetState> datasets(const Caller& caller = {}) const;

  // Adds the numbers of agents and datasets, as they were last seen.
  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

  // Does what CoordinatorServer::WaitUntilReady does.
  absl::Status WaitUntilReady(base::MonotonicTime deadline);

 private:
  using Suspects = std::set<std::string>;  // addresses
  // The findings of one probe.
  struct Snapshot {
    AgentMembers members;
    std::map<std::string, DatasetState> datasets;
    std::string unreachable;        // DescribeUnreachable of the members
    std::set<std::string> opening;  // names of datasets whose shards agents open
    bool is_any_complete = false;   // of the datasets
    base::MonotonicTime probe_begin = base::MonotonicTime::InfinitePast();
  };

  explicit AgentRegistry(AgentRegistryOptions options);
  void Run();
  void Probe(base::MonotonicTime begin);
  [[nodiscard]] rpc::Dialing DialingOf(const AgentMember& member) const;
  void AskMembers(const Suspects& suspects, AgentMembers* members) const;
  void AdoptMembers(AgentMembers members, base::MonotonicTime probe_begin)
      ABSL_LOCKS_EXCLUDED(mutex_);
  [[nodiscard]] std::shared_ptr<const Snapshot> Latest() const ABSL_LOCKS_EXCLUDED(mutex_);
  static absl::StatusOr<std::shared_ptr<const DatasetState>> FindIn(
      const std::shared_ptr<const Snapshot>& snapshot, const std::string& name,
      const Caller& caller);
  // Returns true if agents may be asked for a name that is not in the snapshot.
  bool MayProbeForName(const Snapshot& snapshot) ABSL_LOCKS_EXCLUDED(mutex_);
  // Requests a probe that begins after now, and returns its number.
  std::int64_t RequestProbe() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Requests a probe that begins after now. Waits for its end, until `deadline`, until
  // `cancellation` fires, or until the registry stops.
  void ProbeNow(base::MonotonicTime deadline, const base::Cancellation& cancellation)
      ABSL_LOCKS_EXCLUDED(mutex_);

  const AgentRegistryOptions options_;
  base::Cancellation stopping_;
  mutable base::Mutex mutex_;
  base::CondVar changed_;  // a probe number below has changed, or the registry stops
  std::shared_ptr<const Snapshot> snapshot_ ABSL_GUARDED_BY(mutex_);  // never null
  Suspects suspects_ ABSL_GUARDED_BY(mutex_);  // calls to them failed since they were last asked
  base::MonotonicTime name_probe_ ABSL_GUARDED_BY(mutex_) =
      base::MonotonicTime::InfinitePast();  // the last for a name
  // Probes are numbered from 1 on. A thread that needs a probe that begins after now wants the
  // number after started_probe_, and waits until finished_probe_ has reached it.
  std::int64_t wanted_probe_ ABSL_GUARDED_BY(mutex_) = 1;
  std::int64_t started_probe_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t finished_probe_ ABSL_GUARDED_BY(mutex_) = 0;
  AgentMemberResolver resolver_;  // used by the registry's thread alone
  std::thread thread_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_REGISTRY_H_
