// One probe, on the registry's thread:
//
// 1. The endpoints become members. A plain target is one member. A name in the DNS is one member
//    for each of its addresses. An address that the name has lost stays as long as the agent
//    answers.
// 2. All members are asked at the same time what they serve. A member that failed gets a fresh
//    channel, because a channel that met an error waits before it dials again.
// 3. Answers become states, and states become datasets. Both replace the old ones at once, under
//    the lock.
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
#include "absl/time/clock.h"

#include "core/base/log.h"
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

AgentRegistry::AgentRegistry(AgentRegistryOptions options) : options_(std::move(options)) {
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
      changed_.AwaitUntil(&mutex_, absl::Now() + options_.poll_interval,
                          [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
                            return stopping_.is_cancelled() || wanted_probe_ > started_probe_;
                          });
      if (stopping_.is_cancelled()) {
        return;
      }
      ++started_probe_;
      wanted_probe_ = std::max(wanted_probe_, started_probe_);
    }
    Probe();
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

void AgentRegistry::ResolveList(std::size_t endpoint_index, const std::string& path,
                                Members* members) {
  absl::StatusOr<std::vector<std::string>> targets = ReadAgentList(path);
  for (std::size_t i = 0; targets.ok() && options_.check_target && i < targets->size(); ++i) {
    if (absl::Status status = options_.check_target((*targets)[i]); !status.ok()) {
      targets = std::move(status);
    }
  }
  if (list_errors_[path] != targets.status()) {
    list_errors_[path] = targets.status();
    base::Log(targets.ok() ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              targets.ok() ? "agent_list_read" : "agent_list_not_read",
              {{"file", path}, {"status", targets.status()}});
  }
  const std::string& target = options_.endpoints[endpoint_index].target;
  if (!targets.ok()) {
    const bool is_known = std::any_of(members->begin(), members->end(), [&](const auto& entry) {
      return entry.second.endpoint_index == endpoint_index && entry.first != target;
    });
    if (!is_known) {
      Member& member = (*members)[target];
      member.endpoint_index = endpoint_index;
      member.state.address = target;
      member.state.status = targets.status();
      member.is_name = true;
    }
    return;
  }
  std::erase_if(*members, [&](const auto& entry) {
    return entry.second.endpoint_index == endpoint_index &&
           !std::binary_search(targets->begin(), targets->end(), entry.first);
  });
  for (const std::string& address : *targets) {
    Member& member = (*members)[address];
    member.endpoint_index = endpoint_index;
    member.state.address = address;
  }
}

AgentRegistry::Members AgentRegistry::ResolveMembers(Members members) {
  for (std::size_t i = 0; i < options_.endpoints.size(); ++i) {
    const AgentEndpoint& endpoint = options_.endpoints[i];
    if (const auto list = ParseAgentListTarget(endpoint.target); list.ok() && list->has_value()) {
      ResolveList(i, **list, &members);
      continue;
    }
    const absl::StatusOr<std::optional<DnsName>> name = ParseDnsTarget(endpoint.target);
    if (endpoint.channel != nullptr || !name.ok() || !name->has_value()) {
      Member& member = members[endpoint.target];
      member.endpoint_index = i;
      member.state.address = endpoint.target;
      if (endpoint.channel != nullptr) {
        member.state.channel = endpoint.channel;
        member.has_fixed_channel = true;
      }
      continue;
    }
    const absl::StatusOr<std::vector<std::string>> addresses = options_.resolve(**name);
    if (!addresses.ok()) {
      // A resolver that fails says nothing about agents, so the known ones stay.
      const bool is_known = std::any_of(members.begin(), members.end(), [&](const auto& entry) {
        return entry.second.endpoint_index == i && entry.first != endpoint.target;
      });
      if (!is_known) {
        Member& member = members[endpoint.target];
        member.endpoint_index = i;
        member.state.address = endpoint.target;
        member.state.status = addresses.status();
        member.is_name = true;
      }
      continue;
    }
    members.erase(endpoint.target);
    for (auto& [address, member] : members) {
      if (member.endpoint_index == i) {
        member.is_listed = false;
      }
    }
    for (const std::string& address : *addresses) {
      Member& member = members[address];
      member.endpoint_index = i;
      member.state.address = address;
      member.is_listed = true;
    }
  }
  return members;
}

rpc::Dialing AgentRegistry::DialingOf(const Member& member) const {
  rpc::Dialing dialing = options_.dialing;
  const auto name = ParseDnsTarget(options_.endpoints[member.endpoint_index].target);
  if (dialing.server_name.empty() && name.ok() && name->has_value()) {
    dialing.server_name = (*name)->host;  // the address dialled is one of its numbers
  }
  return dialing;
}

void AgentRegistry::AskMembers(Members* members) const {
  std::vector<Member*> asked;
  std::vector<AgentProbe> probes;
  for (auto& [address, member] : *members) {
    if (member.is_name) {
      continue;
    }
    const bool needs_fresh_channel = !member.state.status.ok() || member.is_suspect;
    asked.push_back(&member);
    probes.push_back({.address = address,
                      .channel = needs_fresh_channel && !member.has_fixed_channel
                                     ? nullptr
                                     : member.state.channel,
                      .dialing = DialingOf(member)});
  }
  options_.probe(absl::MakeSpan(probes), stopping_);
  for (std::size_t i = 0; i < asked.size(); ++i) {
    asked[i]->state.channel = std::move(probes[i].channel);
    AdoptAnswer(std::move(probes[i].answer), &asked[i]->state);
  }
}

void AgentRegistry::Probe() {
  Members members;
  {
    base::MutexLock lock(&mutex_);
    members = members_;
    for (auto& [address, member] : members_) {
      member.is_suspect = false;  // the next probe sees only later failures
    }
  }
  members = ResolveMembers(std::move(members));
  AskMembers(&members);
  if (stopping_.is_cancelled()) {
    return;  // the answers were cut off
  }
  std::erase_if(members, [](const auto& entry) {
    return !entry.second.is_listed && !entry.second.state.status.ok();
  });
  AdoptMembers(std::move(members));
}

void AgentRegistry::LogMembers(const Members& members) const {
  for (const auto& [address, member] : members) {
    const auto before = members_.find(address);
    const bool was_ok = before != members_.end() && before->second.state.status.ok();
    if (member.state.status.ok() && !was_ok) {
      base::LogInfo("agent_found", {{"address", address},
                                    {"shards", member.state.shards.size()},
                                    {"version", member.state.version},
                                    {"renderer", member.state.renderer}});
    } else if (member.state.is_draining && !before->second.state.is_draining) {
      base::LogInfo("agent_drains", {{"address", address}});
    } else if (!member.state.status.ok() && (was_ok || before == members_.end())) {
      base::LogWarning(was_ok ? "agent_lost" : "agent_unreachable",
                       {{"address", address}, {"status", member.state.status}});
    }
  }
  for (const auto& [address, member] : members_) {
    if (members.count(address) == 0) {
      base::LogWarning("agent_gone", {{"address", address}});
    }
  }
}

void AgentRegistry::LogDatasets(const std::map<std::string, DatasetState>& datasets) const {
  for (const auto& [name, state] : datasets) {
    const auto before = datasets_.find(name);
    const absl::Status was =
        before == datasets_.end() ? absl::UnknownError("") : before->second.status;
    const std::string revision = frame::ToString(state.picture_revision);
    if (state.status.ok() && !was.ok()) {
      base::LogInfo(
          "dataset_ready",
          {{"dataset", name}, {"agents", AgentCount(state)}, {"picture_revision", revision}});
    } else if (state.status.ok() && !(state.picture_revision == before->second.picture_revision)) {
      base::LogInfo(
          "dataset_revision",
          {{"dataset", name}, {"agents", AgentCount(state)}, {"picture_revision", revision}});
    } else if (!state.status.ok() && state.status != was) {
      base::LogWarning("dataset_not_ready", {{"dataset", name}, {"status", state.status}});
    }
    if (state.status.ok() && !state.contradiction.empty() &&
        (before == datasets_.end() || before->second.contradiction != state.contradiction)) {
      base::LogWarning("dataset_contradicted",
                       {{"dataset", name}, {"contents", state.contradiction}});
    }
  }
}

void AgentRegistry::AdoptMembers(Members members) {
  std::vector<AgentState> states;
  states.reserve(members.size());
  for (const auto& [address, member] : members) {
    states.push_back(member.state);
  }
  std::map<std::string, DatasetState> datasets = DatasetsOf(states);
  std::string unreachable = DescribeUnreachable(states);
  const bool is_any_complete = std::any_of(
      datasets.begin(), datasets.end(), [](const auto& entry) { return entry.second.status.ok(); });
  {
    base::MutexLock lock(&mutex_);
    LogMembers(members);
    LogDatasets(datasets);
    for (auto& [address, member] : members) {
      const auto before = members_.find(address);
      member.is_suspect = before != members_.end() && before->second.is_suspect;
    }
    members_ = std::move(members);
    datasets_ = std::move(datasets);
    unreachable_ = std::move(unreachable);
    is_any_complete_ = is_any_complete;
  }
}

std::int64_t AgentRegistry::RequestProbe() {
  const std::int64_t awaited = started_probe_ + 1;
  wanted_probe_ = std::max(wanted_probe_, awaited);
  changed_.SignalAll();
  return awaited;
}

void AgentRegistry::ProbeNow(absl::Time deadline, const base::Cancellation& cancellation) {
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

absl::StatusOr<DatasetState> AgentRegistry::FindComplete(const std::string& name,
                                                         const base::Cancellation& cancellation,
                                                         const Caller& caller, bool allow_partial) {
  const auto is_usable = [allow_partial](const DatasetState& state) {
    return state.status.ok() || (allow_partial && !state.replica_sets.empty());
  };
  {
    base::MutexLock lock(&mutex_);
    absl::StatusOr<DatasetState> found = FindDataset(datasets_, name, unreachable_, caller);
    std::set<std::string> suspects;
    for (const auto& [address, member] : members_) {
      if (member.is_suspect) {
        suspects.insert(address);
      }
    }
    if (found.ok() && is_usable(*found)) {
      const std::size_t set_count = found->replica_sets.size();
      RemoveAgents(suspects, &found->replica_sets);
      if (found->replica_sets.size() == set_count) {
        if (!suspects.empty()) {
          RequestProbe();
        }
        return found;
      }
    }
  }
  ProbeNow(std::min(cancellation.deadline(), absl::Now() + kMaxFrameWait), cancellation);
  if (cancellation.is_cancelled()) {
    return cancellation.Check();
  }
  base::MutexLock lock(&mutex_);
  ISOSCOPE_ASSIGN_OR_RETURN(DatasetState found, FindDataset(datasets_, name, unreachable_, caller));
  if (!is_usable(found)) {
    return found.status;
  }
  return found;
}

absl::StatusOr<DatasetState> AgentRegistry::Find(const std::string& name,
                                                 const Caller& caller) const {
  base::MutexLock lock(&mutex_);
  return FindDataset(datasets_, name, unreachable_, caller);
}

void AgentRegistry::ReportFailure(const std::string& address) {
  base::MutexLock lock(&mutex_);
  const auto found = members_.find(address);
  if (found != members_.end()) {
    found->second.is_suspect = true;
  }
}

bool AgentRegistry::IsReachable(const std::string& address) const {
  base::MutexLock lock(&mutex_);
  const auto found = members_.find(address);
  return found != members_.end() && found->second.state.status.ok();
}

std::vector<AgentState> AgentRegistry::agents() const {
  base::MutexLock lock(&mutex_);
  std::vector<AgentState> states;
  states.reserve(members_.size());
  for (const auto& [address, member] : members_) {
    states.push_back(member.state);
  }
  return states;
}

std::map<std::string, DatasetState> AgentRegistry::datasets(const Caller& caller) const {
  base::MutexLock lock(&mutex_);
  return DatasetsFor(caller, datasets_);
}

absl::Status AgentRegistry::WaitUntilReady(absl::Time deadline) {
  const base::Cancellation never;
  while (true) {
    {
      base::MutexLock lock(&mutex_);
      const bool has_all = finished_probe_ > 0 && unreachable_.empty();
      if (has_all && is_any_complete_) {
        return absl::OkStatus();
      }
      if (absl::Now() >= deadline || stopping_.is_cancelled()) {
        if (!unreachable_.empty() || datasets_.empty()) {
          return absl::FailedPreconditionError(unreachable_.empty() ? "the agents serve no dataset"
                                                                    : unreachable_);
        }
        return datasets_.begin()->second.status;
      }
    }
    ProbeNow(std::min(deadline, absl::Now() + kMaxFrameWait), never);
    base::MutexLock lock(&mutex_);
    if (!is_any_complete_) {
      changed_.AwaitUntil(&mutex_, std::min(deadline, absl::Now() + kRetryInterval),
                          [this] { return stopping_.is_cancelled(); });
    }
  }
}

}  // namespace isoscope::server
