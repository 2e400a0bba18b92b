// One probe, on the registry's thread:
//
// 1. The endpoints become members (agent_members).
// 2. All members are asked at the same time for their shards. A member that failed gets a fresh
//    channel, because a channel that met an error waits before it dials again.
// 3. Answers become states, and states become datasets. Both form a snapshot that replaces the old
//    one at once. Only the replacement holds the lock: logging may block, and snapshots may be
//    large.
//
// A call that fails makes its agent suspect (ReportFailure). The next frame then waits for a probe
// that begins after the failure. A failure reported while a probe is under way still counts.

#include "server/cluster/agent_registry.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "server/cluster/agent_list.h"

namespace isoscope::server {
namespace {

// The pause between two probes while WaitUntilReady waits.
constexpr absl::Duration kRetryInterval = absl::Milliseconds(50);

// Returns the number of agents that frames of the dataset may use.
std::size_t AgentCount(const DatasetState& state) {
  std::set<std::string> addresses;
  for (const ReplicaSet& set : state.replica_sets) {
    for (const ServingAgent& agent : set.agents) {
      addresses.insert(agent.address);
    }
  }
  return addresses.size();
}

// The tenth of the opening that an agent is in; -1: it opens nothing.
int TenthOf(const std::optional<isoscope::v1::OpeningProgress>& progress) {
  constexpr double kTenths = 10;
  if (!progress.has_value()) {
    return -1;
  }
  const double all = static_cast<double>(progress->table_bytes());
  return all <= 0 ? 0
                  : static_cast<int>(kTenths * static_cast<double>(progress->read_bytes()) / all);
}

// These log the changes from `before` to `after`. A blocked reader of the log blocks no other
// thread: no lock is held.
void LogMembers(const AgentMembers& before, const AgentMembers& after) {
  for (const auto& [address, member] : after) {
    const auto known = before.find(address);
    const bool was_ok = known != before.end() && known->second.state.status.ok();
    if (member.state.status.ok() && !was_ok) {
      base::LogInfo("agent_found", {{"address", address},
                                    {"shards", member.state.shards.size()},
                                    {"version", member.state.version},
                                    {"renderer", member.state.renderer}});
    } else if (member.state.status.ok() && member.state.is_draining &&
               !known->second.state.is_draining) {
      base::LogInfo("agent_drains", {{"address", address}});
    } else if (member.state.opening.has_value()) {
      if (known == before.end() ||
          TenthOf(known->second.state.opening) != TenthOf(member.state.opening)) {
        base::LogInfo("agent_opening",
                      {{"address", address}, {"progress", member.state.status.message()}});
      }
    } else if (!member.state.status.ok() && (was_ok || known == before.end())) {
      base::LogWarning(was_ok ? "agent_lost" : "agent_unreachable",
                       {{"address", address}, {"status", member.state.status}});
    }
  }
  for (const auto& [address, member] : before) {
    if (after.count(address) == 0) {
      base::LogWarning("agent_gone", {{"address", address}});
    }
  }
}

void LogDatasets(const std::map<std::string, DatasetState>& before,
                 const std::map<std::string, DatasetState>& after) {
  for (const auto& [name, state] : after) {
    const auto known = before.find(name);
    const absl::Status was = known == before.end() ? absl::UnknownError("") : known->second.status;
    const std::string revision = frame::ToString(state.picture_revision);
    if (state.status.ok() && !was.ok()) {
      base::LogInfo(
          "dataset_ready",
          {{"dataset", name}, {"agents", AgentCount(state)}, {"picture_revision", revision}});
    } else if (state.status.ok() && !(state.picture_revision == known->second.picture_revision)) {
      base::LogInfo(
          "dataset_revision",
          {{"dataset", name}, {"agents", AgentCount(state)}, {"picture_revision", revision}});
    } else if (!state.status.ok() && state.status != was) {
      base::LogWarning("dataset_not_ready", {{"dataset", name}, {"status", state.status}});
    }
    if (state.status.ok() && !state.contradiction.empty() &&
        (known == before.end() || known->second.contradiction != state.contradiction)) {
      base::LogWarning("dataset_contradicted",
                       {{"dataset", name}, {"contents", base::OwnText{state.contradiction}}});
    }
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<AgentRegistry>> AgentRegistry::Start(
    const AgentRegistryOptions& options) {
  if (options.endpoints.empty()) {
    return absl::InvalidArgumentError("no agent: name at least one");
  }
  if (options.poll_interval <= absl::ZeroDuration()) {
    return absl::InvalidArgumentError(absl::StrCat("poll interval is ",
                                                   absl::FormatDuration(options.poll_interval),
                                                   ": must be greater than 0"));
  }
  std::set<std::string> targets;
  for (const AgentEndpoint& endpoint : options.endpoints) {
    ISOSCOPE_RETURN_IF_ERROR(ParseDnsTarget(endpoint.target).status());
    ISOSCOPE_RETURN_IF_ERROR(ParseAgentListTarget(endpoint.target).status());
    if (!targets.insert(endpoint.target).second) {
      return absl::InvalidArgumentError(
          absl::StrCat("agent target \"", endpoint.target, "\" is given twice: name it once"));
    }
  }
  return std::unique_ptr<AgentRegistry>(new AgentRegistry(options));
}

AgentRegistry::AgentRegistry(AgentRegistryOptions options)
    : options_(std::move(options)),
      snapshot_(std::make_shared<const Snapshot>()),
      resolver_(options_.endpoints, options_.check_target, options_.resolve) {
  thread_ = std::thread([this] { Run(); });
}

AgentRegistry::~AgentRegistry() {
  stopping_.Cancel();
  {
    base::MutexLock lock(&mutex_);
    changed_.SignalAll();
  }
  thread_.join();
}

void AgentRegistry::Run() {
  while (true) {
    {
      base::MutexLock lock(&mutex_);
      changed_.AwaitUntil(&mutex_, base::MonotonicNow() + options_.poll_interval,
                          [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
                            return stopping_.is_cancelled() || wanted_probe_ > started_probe_;
                          });
      if (stopping_.is_cancelled()) {
        return;
      }
      ++started_probe_;
      wanted_probe_ = std::max(wanted_probe_, started_probe_);
    }
    Probe(base::MonotonicNow());
    bool is_first = false;
    {
      base::MutexLock lock(&mutex_);
      finished_probe_ = started_probe_;
      is_first = finished_probe_ == 1;
      changed_.SignalAll();
    }
    if (is_first && options_.on_first_probe != nullptr) {
      options_.on_first_probe();
    }
  }
}

rpc::Dialing AgentRegistry::DialingOf(const AgentMember& member) const {
  rpc::Dialing dialing = options_.dialing;
  const auto name = ParseDnsTarget(options_.endpoints[member.endpoint_index].target);
  if (dialing.server_name.empty() && name.ok() && name->has_value()) {
    dialing.server_name = (*name)->host;  // the address dialled is one of its numbers
  }
  return dialing;
}

void AgentRegistry::AskMembers(const Suspects& suspects, AgentMembers* members) const {
  std::vector<AgentMember*> asked;
  std::vector<AgentProbe> probes;
  for (auto& [address, member] : *members) {
    if (member.is_name) {
      continue;
    }
    const bool needs_fresh_channel = !member.state.status.ok() || suspects.contains(address);
    asked.push_back(&member);
    probes.push_back({.address = address,
                      .channel = needs_fresh_channel && !member.has_fixed_channel
                                     ? nullptr
                                     : member.state.channel,
                      .export_channel = member.state.export_channel,
                      .dialing = DialingOf(member)});
  }
  options_.probe(absl::MakeSpan(probes), stopping_);
  for (std::size_t i = 0; i < asked.size(); ++i) {
    asked[i]->state.channel = std::move(probes[i].channel);
    asked[i]->state.export_channel = std::move(probes[i].export_channel);
    AdoptAnswer(std::move(probes[i].answer), &asked[i]->state);
  }
}

void AgentRegistry::Probe(base::MonotonicTime begin) {
  std::shared_ptr<const Snapshot> before;
  Suspects suspects;
  {
    base::MutexLock lock(&mutex_);
    before = snapshot_;
    suspects.swap(suspects_);  // the next probe sees only later failures
  }
  AgentMembers members = resolver_.Resolve(before->members);
  AskMembers(suspects, &members);
  if (stopping_.is_cancelled()) {
    return;  // the answers were cut off
  }
  std::erase_if(members, [](const auto& entry) {
    return !entry.second.is_listed && !entry.second.state.status.ok();
  });
  AdoptMembers(std::move(members), begin);
}

void AgentRegistry::AdoptMembers(AgentMembers members, base::MonotonicTime probe_begin) {
  std::vector<AgentState> states;
  states.reserve(members.size());
  for (const auto& [address, member] : members) {
    states.push_back(member.state);
  }
  auto after = std::make_shared<Snapshot>();
  after->datasets = DatasetsOf(states);
  after->unreachable = DescribeUnreachable(states);
  after->opening = OpeningDatasets(states);
  after->is_any_complete = std::any_of(after->datasets.begin(), after->datasets.end(),
                                       [](const auto& entry) { return entry.second.status.ok(); });
  after->members = std::move(members);
  after->probe_begin = probe_begin;
  std::shared_ptr<const Snapshot> before = after;
  {
    base::MutexLock lock(&mutex_);
    before.swap(snapshot_);
  }
  LogMembers(before->members, after->members);
  LogDatasets(before->datasets, after->datasets);
}

std::int64_t AgentRegistry::RequestProbe() {
  const std::int64_t awaited = started_probe_ + 1;
  wanted_probe_ = std::max(wanted_probe_, awaited);
  changed_.SignalAll();
  return awaited;
}

void AgentRegistry::ProbeNow(base::MonotonicTime deadline, const base::Cancellation& cancellation) {
  const base::Cancellation::Callback wake(cancellation, [this] {
    base::MutexLock lock(&mutex_);
    changed_.SignalAll();
  });
  base::MutexLock lock(&mutex_);
  const std::int64_t awaited = RequestProbe();
  changed_.AwaitUntil(&mutex_, deadline,
                      [this, awaited, &cancellation]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
                        return finished_probe_ >= awaited || cancellation.is_cancelled() ||
                               stopping_.is_cancelled();
                      });
}

std::shared_ptr<const AgentRegistry::Snapshot> AgentRegistry::Latest() const {
  base::MutexLock lock(&mutex_);
  return snapshot_;
}

// The result keeps its whole snapshot.
absl::StatusOr<std::shared_ptr<const DatasetState>> AgentRegistry::FindIn(
    const std::shared_ptr<const Snapshot>& snapshot, const std::string& name,
    const Caller& caller) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const DatasetState* const found,
      FindDataset(snapshot->datasets, name, snapshot->unreachable, caller, snapshot->opening));
  return std::shared_ptr<const DatasetState>(snapshot, found);
}

bool AgentRegistry::MayProbeForName(const Snapshot& snapshot) {
  const base::MonotonicTime now = base::MonotonicNow();
  base::MutexLock lock(&mutex_);
  if (!snapshot.datasets.empty() &&
      now - std::max(snapshot.probe_begin, name_probe_) < kMissingNameInterval) {
    return false;
  }
  name_probe_ = now;
  return true;
}

absl::StatusOr<std::shared_ptr<const DatasetState>> AgentRegistry::FindComplete(
    const std::string& name, const base::Cancellation& cancellation, const Caller& caller,
    bool allow_partial) {
  const auto is_usable = [allow_partial](const DatasetState& state) {
    return state.status.ok() || (allow_partial && !state.replica_sets.empty());
  };
  std::shared_ptr<const Snapshot> snapshot;
  Suspects suspects;
  {
    base::MutexLock lock(&mutex_);
    snapshot = snapshot_;
    suspects = suspects_;
  }
  absl::StatusOr<std::shared_ptr<const DatasetState>> found = FindIn(snapshot, name, caller);
  if (found.ok() && is_usable(**found)) {
    if (suspects.empty()) {
      return found;
    }
    auto others = std::make_shared<DatasetState>(**found);
    RemoveAgents(suspects, &others->replica_sets);
    if (others->replica_sets.size() == (*found)->replica_sets.size()) {
      base::MutexLock lock(&mutex_);
      RequestProbe();
      return others;
    }
  }
  if (absl::IsNotFound(found.status()) && !MayProbeForName(*snapshot)) {
    return found;
  }
  ProbeNow(std::min(cancellation.deadline(), base::MonotonicNow() + kMaxFrameWait), cancellation);
  if (cancellation.is_cancelled()) {
    return cancellation.Check();
  }
  found = FindIn(Latest(), name, caller);
  if (found.ok() && !is_usable(**found)) {
    return (*found)->status;
  }
  return found;
}

absl::StatusOr<std::shared_ptr<const DatasetState>> AgentRegistry::Find(
    const std::string& name, const Caller& caller) const {
  return FindIn(Latest(), name, caller);
}

void AgentRegistry::ReportFailure(const std::string& address) {
  base::MutexLock lock(&mutex_);
  if (snapshot_->members.contains(address)) {
    suspects_.insert(address);
  }
}

bool AgentRegistry::IsReachable(const std::string& address) const {
  const std::shared_ptr<const Snapshot> snapshot = Latest();
  const auto found = snapshot->members.find(address);
  return found != snapshot->members.end() && found->second.state.status.ok();
}

std::vector<AgentState> AgentRegistry::agents() const {
  const std::shared_ptr<const Snapshot> snapshot = Latest();
  std::vector<AgentState> states;
  states.reserve(snapshot->members.size());
  for (const auto& [address, member] : snapshot->members) {
    states.push_back(member.state);
  }
  return states;
}

std::map<std::string, DatasetState> AgentRegistry::datasets(const Caller& caller) const {
  return DatasetsFor(caller, Latest()->datasets);
}

void AgentRegistry::AppendMetrics(std::vector<base::MetricFamily>* families) const {
  using base::MetricSample;
  constexpr auto kGauge = base::MetricFamily::Type::kGauge;
  const std::shared_ptr<const Snapshot> snapshot = Latest();
  int reachable = 0;
  int unreachable = 0;
  int opening = 0;
  std::size_t damaged_shards = 0;
  for (const auto& [address, member] : snapshot->members) {
    const AgentState& agent = member.state;
    ++(agent.status.ok() ? reachable : agent.opening.has_value() ? opening : unreachable);
    damaged_shards += static_cast<std::size_t>(agent.damaged_shards.size());
  }
  int complete = 0;
  int incomplete = 0;
  for (const auto& [name, dataset] : snapshot->datasets) {
    ++(dataset.status.ok() ? complete : incomplete);
  }
  families->push_back({.name = "isoscope_agents",
                       .help = "Agents, as they were last seen.",
                       .type = kGauge,
                       .samples = {MetricSample::Of(reachable, {{"state", "reachable"}}),
                                   MetricSample::Of(unreachable, {{"state", "unreachable"}}),
                                   MetricSample::Of(opening, {{"state", "opening"}})}});
  families->push_back({.name = "isoscope_damaged_shards",
                       .help = "Shards with files that their agents could not read.",
                       .type = kGauge,
                       .samples = {MetricSample::Of(static_cast<double>(damaged_shards))}});
  families->push_back(
      {.name = "isoscope_datasets",
       .help = "Datasets; of a complete one all shards are served, by agents of one picture "
               "revision.",
       .type = kGauge,
       .samples = {MetricSample::Of(complete, {{"state", "complete"}}),
                   MetricSample::Of(incomplete, {{"state", "incomplete"}})}});
}

absl::Status AgentRegistry::WaitUntilReady(base::MonotonicTime deadline) {
  const base::Cancellation never;
  while (true) {
    {
      base::MutexLock lock(&mutex_);
      const std::string& unreachable = snapshot_->unreachable;
      const bool has_all = finished_probe_ > 0 && unreachable.empty();
      if (has_all && snapshot_->is_any_complete) {
        return absl::OkStatus();
      }
      if (base::MonotonicNow() >= deadline || stopping_.is_cancelled()) {
        if (!unreachable.empty() || snapshot_->datasets.empty()) {
          return absl::FailedPreconditionError(unreachable.empty() ? "the agents serve no dataset"
                                                                   : unreachable);
        }
        return snapshot_->datasets.begin()->second.status;
      }
    }
    ProbeNow(std::min(deadline, base::MonotonicNow() + kMaxFrameWait), never);
    base::MutexLock lock(&mutex_);
    if (!snapshot_->is_any_complete) {
      changed_.AwaitUntil(&mutex_, std::min(deadline, base::MonotonicNow() + kRetryInterval),
                          [this] { return stopping_.is_cancelled(); });
    }
  }
}

}  // namespace isoscope::server
