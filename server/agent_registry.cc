#include "server/agent_registry.h"

#include <netdb.h>

#include <algorithm>
#include <optional>
#include <set>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include <netinet/in.h>
#include <sys/socket.h>

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::internal::v1;

constexpr char kDnsScheme[] = "dns:///";
// How many shards a message names before it says "...".
constexpr std::size_t kMaxNamedShards = 16;

std::string Identity(const v1::ShardDescription& shard) {
  return absl::StrFormat("id %s, %d shards, manifest crc32c %08x, range table crc32c %08x",
                         shard.dataset().dataset_id(), shard.dataset().shard_count(),
                         shard.manifest_crc32c(), shard.range_table_crc32c());
}

// The first thing that is wrong with what an agent said.
absl::Status Validate(const v1::DescribeShardsResponse& response) {
  for (int i = 0; i < response.shards_size(); ++i) {
    const v1::ShardDescription& shard = response.shards(i);
    const std::string path = absl::StrCat("shards[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(rpc::Validate(shard.dataset(), absl::StrCat(path, ".dataset")));
    if (shard.shard_index() < 0 || shard.shard_index() >= shard.dataset().shard_count()) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".shard_index is ", shard.shard_index(),
                                                     ": must lie in [0, ",
                                                     shard.dataset().shard_count(), ")"));
    }
  }
  return absl::OkStatus();
}

std::string JoinShards(const std::vector<int>& shards) {
  if (shards.size() <= kMaxNamedShards) {
    return absl::StrJoin(shards, ", ");
  }
  return absl::StrCat(
      absl::StrJoin(shards.begin(), shards.begin() + static_cast<std::ptrdiff_t>(kMaxNamedShards),
                    ", "),
      ", ... (", shards.size(), " in all)");
}

// One dataset while the agents are gone through.
struct Draft {
  const v1::ShardDescription* reference = nullptr;
  std::string reference_address;
  bool is_reference_served = false;
  std::string contradiction;
  std::map<int, const AgentState*> owners;  // of shards that are served
};

void AddToDraft(const AgentState& agent, const v1::ShardDescription& shard, Draft* draft) {
  const bool is_served = agent.status.ok();
  // What is served now decides; what was served before only tells that there is such a dataset.
  if (draft->reference == nullptr || (is_served && !draft->is_reference_served)) {
    draft->reference = &shard;
    draft->reference_address = agent.address;
    draft->is_reference_served = is_served;
  }
  if (!is_served) {
    return;
  }
  if (Identity(shard) != Identity(*draft->reference)) {
    if (draft->contradiction.empty()) {
      draft->contradiction =
          absl::StrCat("agent ", draft->reference_address, " serves ", Identity(*draft->reference),
                       "; agent ", agent.address, " serves ", Identity(shard));
    }
    return;
  }
  draft->owners.emplace(shard.shard_index(), &agent);
}

DatasetState Complete(const std::string& name, const Draft& draft, absl::string_view unreachable) {
  DatasetState state;
  state.dataset = draft.reference->dataset();
  state.is_served = draft.is_reference_served;
  std::vector<int> missing;
  for (int shard = 0; shard < state.dataset.shard_count(); ++shard) {
    if (draft.owners.count(shard) == 0 || !draft.contradiction.empty()) {
      missing.push_back(shard);
      state.dataset.add_missing_shards(shard);
    }
  }
  if (!draft.contradiction.empty()) {
    state.status = absl::FailedPreconditionError(
        absl::StrCat("dataset \"", name, "\": agents contradict each other: ", draft.contradiction,
                     "; serve shards of one `isoscope partition` run"));
    return state;
  }
  if (!missing.empty()) {
    state.status = absl::FailedPreconditionError(absl::StrCat(
        "dataset \"", name, "\": ", missing.size() == 1 ? "shard " : "shards ", JoinShards(missing),
        " of ", state.dataset.shard_count(), " not served by any agent; ",
        unreachable.empty() ? "all agents answer: start agents for them" : unreachable));
    return state;
  }
  const AgentState& first = *draft.owners.begin()->second;
  for (const auto& [shard, owner] : draft.owners) {
    if (!(owner->picture_revision == first.picture_revision)) {
      state.status = absl::FailedPreconditionError(absl::StrCat(
          "dataset \"", name, "\": agents would draw different pictures: agent ", first.address,
          " has picture revision ", frame::ToString(first.picture_revision), ", agent ",
          owner->address, " has ", frame::ToString(owner->picture_revision),
          "; run one version with one --renderer on all of them"));
      return state;
    }
  }
  state.picture_revision = first.picture_revision;
  // The owners in order of their first shards: the order of agents does not depend on addresses.
  std::map<const AgentState*, std::size_t> place_of;
  for (const auto& [shard, owner] : draft.owners) {
    const auto [place, is_new] = place_of.emplace(owner, state.agents.size());
    if (is_new) {
      state.agents.push_back({owner->address, owner->channel, {}});
    }
    state.agents[place->second].shard_indices.push_back(shard);
  }
  return state;
}

std::string DescribeUnreachable(const std::vector<AgentState>& agents) {
  std::vector<std::string> parts;
  for (const AgentState& agent : agents) {
    if (!agent.status.ok()) {
      parts.push_back(absl::StrCat(agent.address, " (", agent.status.message(), ")"));
    }
  }
  return parts.empty() ? ""
                       : absl::StrCat("agents that can't be reached: ", absl::StrJoin(parts, ", "));
}

// Waits for the answers of several agents.
class AnswerCollector {
 public:
  explicit AnswerCollector(std::size_t count) : answers_(count), missing_(count) {}

  void Set(std::size_t index, absl::StatusOr<v1::DescribeShardsResponse> answer) {
    absl::MutexLock lock(&mutex_);
    answers_[index] = std::move(answer);
    --missing_;
  }
  std::vector<std::optional<absl::StatusOr<v1::DescribeShardsResponse>>> Wait() {
    absl::MutexLock lock(&mutex_);
    const auto is_complete = [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return missing_ == 0; };
    mutex_.Await(absl::Condition(&is_complete));
    return std::move(answers_);
  }

 private:
  absl::Mutex mutex_;
  std::vector<std::optional<absl::StatusOr<v1::DescribeShardsResponse>>> answers_
      ABSL_GUARDED_BY(mutex_);
  std::size_t missing_ ABSL_GUARDED_BY(mutex_);
};

void Adopt(absl::StatusOr<v1::DescribeShardsResponse> answer, AgentState* state) {
  if (!answer.ok()) {
    state->status = std::move(answer).status();
    return;
  }
  state->version = answer->version();
  state->renderer = answer->renderer();
  absl::StatusOr<frame::PictureRevision> revision =
      rpc::PictureRevisionFromProto(answer->picture_revision(), "picture_revision");
  absl::Status status = Validate(*answer);
  status.Update(revision.status());
  if (!status.ok()) {
    state->status = std::move(status);
    state->shards.clear();
    return;
  }
  state->picture_revision = *std::move(revision);
  state->status = absl::OkStatus();
  state->shards.assign(answer->shards().begin(), answer->shards().end());
}

}  // namespace

std::map<std::string, DatasetState> DatasetsOf(const std::vector<AgentState>& agents) {
  std::map<std::string, Draft> drafts;
  for (const AgentState& agent : agents) {
    for (const v1::ShardDescription& shard : agent.shards) {
      AddToDraft(agent, shard, &drafts[shard.dataset().name()]);
    }
  }
  const std::string unreachable = DescribeUnreachable(agents);
  std::map<std::string, DatasetState> datasets;
  for (const auto& [name, draft] : drafts) {
    datasets.emplace(name, Complete(name, draft, unreachable));
  }
  return datasets;
}

absl::StatusOr<bool> ParseDnsTarget(const std::string& target, DnsName* name) {
  absl::string_view rest = target;
  if (rest.empty()) {
    return absl::InvalidArgumentError(
        "agent target is empty: must be HOST:PORT or any gRPC target");
  }
  if (!absl::ConsumePrefix(&rest, kDnsScheme)) {
    return false;
  }
  const absl::string_view::size_type colon = rest.rfind(':');
  absl::string_view host = rest.substr(0, colon);
  if (colon == absl::string_view::npos || host.empty() || colon + 1 == rest.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("agent target \"", target, "\": must be dns:///NAME:PORT"));
  }
  if (absl::ConsumePrefix(&host, "[")) {
    absl::ConsumeSuffix(&host, "]");
  }
  name->host = std::string(host);
  name->port = std::string(rest.substr(colon + 1));
  return true;
}

absl::StatusOr<std::vector<std::string>> ResolveAddresses(const DnsName& name) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int error = getaddrinfo(name.host.c_str(), name.port.c_str(), &hints, &found);
  if (error != 0) {
    return absl::UnavailableError(
        absl::StrCat("can't resolve ", name.host, ":", name.port, ": ", gai_strerror(error)));
  }
  const auto free_found = absl::MakeCleanup([found] { freeaddrinfo(found); });
  std::set<std::string> addresses;
  for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next) {
    char host[NI_MAXHOST];
    char port[NI_MAXSERV];
    if (getnameinfo(entry->ai_addr, entry->ai_addrlen, host, sizeof(host), port, sizeof(port),
                    NI_NUMERICHOST | NI_NUMERICSERV) == 0) {
      addresses.insert(entry->ai_family == AF_INET6 ? absl::StrCat("[", host, "]:", port)
                                                    : absl::StrCat(host, ":", port));
    }
  }
  return std::vector<std::string>(addresses.begin(), addresses.end());
}

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
    DnsName name;
    ISOSCOPE_RETURN_IF_ERROR(ParseDnsTarget(endpoint.target, &name).status());
    if (!targets.insert(endpoint.target).second) {
      return absl::InvalidArgumentError(
          absl::StrCat("agent target \"", endpoint.target, "\" is given twice: name it once"));
    }
  }
  AgentRegistryOptions complete = options;
  if (complete.resolve == nullptr) {
    complete.resolve = ResolveAddresses;
  }
  return std::unique_ptr<AgentRegistry>(new AgentRegistry(std::move(complete)));
}

AgentRegistry::AgentRegistry(AgentRegistryOptions options) : options_(std::move(options)) {
  thread_ = std::thread([this] { Run(); });
}

AgentRegistry::~AgentRegistry() {
  {
    absl::MutexLock lock(&mutex_);
    is_stopping_ = true;
  }
  thread_.join();
}

void AgentRegistry::Run() {
  while (true) {
    {
      absl::MutexLock lock(&mutex_);
      const auto is_asked_or_stops = [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return is_stopping_ || wanted_probe_ > started_probe_;
      };
      mutex_.AwaitWithTimeout(absl::Condition(&is_asked_or_stops), options_.poll_interval);
      if (is_stopping_) {
        return;
      }
      ++started_probe_;
      wanted_probe_ = std::max(wanted_probe_, started_probe_);
    }
    Probe();
    absl::MutexLock lock(&mutex_);
    finished_probe_ = started_probe_;
  }
}

std::map<std::string, AgentRegistry::Link> AgentRegistry::ResolveLinks(
    std::map<std::string, Link> links) const {
  for (std::size_t i = 0; i < options_.endpoints.size(); ++i) {
    const AgentEndpoint& endpoint = options_.endpoints[i];
    DnsName name;
    const absl::StatusOr<bool> is_dns = ParseDnsTarget(endpoint.target, &name);
    if (endpoint.channel != nullptr || !is_dns.ok() || !*is_dns) {
      Link& link = links[endpoint.target];
      link.endpoint_index = i;
      link.state.address = endpoint.target;
      if (endpoint.channel != nullptr) {
        link.state.channel = endpoint.channel;
        link.has_fixed_channel = true;
      }
      continue;
    }
    const absl::StatusOr<std::vector<std::string>> addresses = options_.resolve(name);
    if (!addresses.ok()) {
      // A resolver that fails says nothing about agents: keep those that are known.
      const bool is_known = std::any_of(links.begin(), links.end(), [&](const auto& entry) {
        return entry.second.endpoint_index == i && entry.first != endpoint.target;
      });
      if (!is_known) {
        Link& link = links[endpoint.target];
        link.endpoint_index = i;
        link.state.address = endpoint.target;
        link.state.status = addresses.status();
      }
      continue;
    }
    links.erase(endpoint.target);
    for (auto& [address, link] : links) {
      if (link.endpoint_index == i) {
        link.is_listed = false;
      }
    }
    for (const std::string& address : *addresses) {
      Link& link = links[address];
      link.endpoint_index = i;
      link.state.address = address;
      link.is_listed = true;
    }
  }
  return links;
}

void AgentRegistry::Probe() {
  std::map<std::string, Link> links;
  {
    absl::MutexLock lock(&mutex_);
    links = links_;
    for (auto& [address, link] : links_) {
      link.is_suspect = false;  // what fails from now on is news
    }
  }
  links = ResolveLinks(std::move(links));

  std::vector<Link*> asked;
  for (auto& [address, link] : links) {
    const AgentEndpoint& endpoint = options_.endpoints[link.endpoint_index];
    if (address == endpoint.target && absl::StartsWith(address, kDnsScheme) &&
        !link.has_fixed_channel) {
      continue;  // a name that could not be resolved
    }
    asked.push_back(&link);
    // A channel that met an error waits before it dials again; a fresh one dials now.
    if (!link.has_fixed_channel &&
        (link.state.channel == nullptr || !link.state.status.ok() || link.is_suspect)) {
      link.state.channel = rpc::MakeFreshChannel(address);
    }
  }
  const auto collector = std::make_shared<AnswerCollector>(asked.size());
  const absl::Time deadline = absl::Now() + kProbeTimeout;
  std::vector<std::shared_ptr<void>> calls;  // until they are answered
  calls.reserve(asked.size());
  for (std::size_t i = 0; i < asked.size(); ++i) {
    calls.push_back(
        DescribeShards(asked[i]->state.channel, deadline,
                       [collector, i](absl::StatusOr<v1::DescribeShardsResponse> answer) {
                         collector->Set(i, std::move(answer));
                       }));
  }
  auto answers = collector->Wait();
  for (std::size_t i = 0; i < asked.size(); ++i) {
    Adopt(*std::move(answers[i]), &asked[i]->state);
  }
  for (auto entry = links.begin(); entry != links.end();) {
    const bool is_gone = !entry->second.is_listed && !entry->second.state.status.ok();
    entry = is_gone ? links.erase(entry) : std::next(entry);
  }
  AdoptLinks(std::move(links));
}

void AgentRegistry::AdoptLinks(std::map<std::string, Link> links) {
  std::vector<AgentState> states;
  states.reserve(links.size());
  for (const auto& [address, link] : links) {
    states.push_back(link.state);
  }
  std::map<std::string, DatasetState> datasets = DatasetsOf(states);
  const bool is_any_complete = std::any_of(
      datasets.begin(), datasets.end(), [](const auto& entry) { return entry.second.status.ok(); });
  bool readiness_changed = false;
  {
    absl::MutexLock lock(&mutex_);
    for (auto& [address, link] : links) {
      const auto before = links_.find(address);
      const bool was_ok = before != links_.end() && before->second.state.status.ok();
      if (link.state.status.ok() && !was_ok) {
        base::LogInfo("agent_found", {{"address", address},
                                      {"shards", link.state.shards.size()},
                                      {"version", link.state.version},
                                      {"renderer", link.state.renderer}});
      } else if (!link.state.status.ok() && (was_ok || before == links_.end())) {
        base::LogWarning(was_ok ? "agent_lost" : "agent_unreachable",
                         {{"address", address}, {"status", link.state.status}});
      }
      // A failure that was reported while the agents were asked still counts.
      link.is_suspect = before != links_.end() && before->second.is_suspect;
    }
    for (const auto& [address, link] : links_) {
      if (links.count(address) == 0) {
        base::LogWarning("agent_gone", {{"address", address}});
      }
    }
    for (const auto& [name, state] : datasets) {
      const auto before = datasets_.find(name);
      const absl::Status was =
          before == datasets_.end() ? absl::UnknownError("") : before->second.status;
      if (state.status.ok() && !was.ok()) {
        base::LogInfo("dataset_ready", {{"dataset", name}, {"agents", state.agents.size()}});
      } else if (!state.status.ok() && state.status != was) {
        base::LogWarning("dataset_not_ready", {{"dataset", name}, {"status", state.status}});
      }
    }
    links_ = std::move(links);
    datasets_ = std::move(datasets);
    readiness_changed = is_any_complete != is_any_complete_;
    is_any_complete_ = is_any_complete;
  }
  if (readiness_changed && options_.on_readiness != nullptr) {
    options_.on_readiness(is_any_complete);
  }
}

void AgentRegistry::ProbeNow(absl::Time deadline) {
  absl::MutexLock lock(&mutex_);
  const std::int64_t awaited = started_probe_ + 1;
  wanted_probe_ = std::max(wanted_probe_, awaited);
  const auto is_done = [this, awaited]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return is_stopping_ || finished_probe_ >= awaited;
  };
  mutex_.AwaitWithDeadline(absl::Condition(&is_done), deadline);
}

std::string AgentRegistry::UnreachableAgents() const {
  std::vector<AgentState> states;
  for (const auto& [address, link] : links_) {
    states.push_back(link.state);
  }
  return DescribeUnreachable(states);
}

absl::StatusOr<DatasetState> AgentRegistry::FindLocked(const std::string& name) const {
  const std::string unreachable = UnreachableAgents();
  const std::string suffix = unreachable.empty() ? "" : absl::StrCat("; ", unreachable);
  if (name.empty() && datasets_.size() == 1) {
    return datasets_.begin()->second;
  }
  const std::string known =
      datasets_.empty()
          ? "no dataset is served"
          : absl::StrCat("there are: ",
                         absl::StrJoin(datasets_, ", ", [](std::string* out, const auto& entry) {
                           absl::StrAppend(out, "\"", entry.first, "\"");
                         }));
  if (name.empty()) {
    if (datasets_.empty()) {
      return absl::FailedPreconditionError(absl::StrCat(known, suffix));
    }
    return absl::InvalidArgumentError(
        absl::StrCat("dataset is empty: must name one of several; ", known));
  }
  const auto found = datasets_.find(name);
  if (found == datasets_.end()) {
    return absl::NotFoundError(absl::StrCat("dataset \"", name, "\": ", known, suffix));
  }
  return found->second;
}

absl::StatusOr<DatasetState> AgentRegistry::FindComplete(const std::string& name,
                                                         absl::Time deadline) {
  {
    absl::MutexLock lock(&mutex_);
    absl::StatusOr<DatasetState> found = FindLocked(name);
    const bool is_any_suspect = std::any_of(
        links_.begin(), links_.end(), [](const auto& entry) { return entry.second.is_suspect; });
    if (found.ok() && found->status.ok() && !is_any_suspect) {
      return found;
    }
  }
  ProbeNow(std::min(deadline, absl::Now() + kMaxFrameWait));
  absl::MutexLock lock(&mutex_);
  ISOSCOPE_ASSIGN_OR_RETURN(DatasetState found, FindLocked(name));
  ISOSCOPE_RETURN_IF_ERROR(found.status);
  return found;
}

absl::StatusOr<DatasetState> AgentRegistry::Find(const std::string& name) const {
  absl::MutexLock lock(&mutex_);
  return FindLocked(name);
}

void AgentRegistry::ReportFailure(const std::string& address) {
  absl::MutexLock lock(&mutex_);
  const auto found = links_.find(address);
  if (found != links_.end()) {
    found->second.is_suspect = true;
  }
}

std::vector<AgentState> AgentRegistry::agents() const {
  absl::MutexLock lock(&mutex_);
  std::vector<AgentState> states;
  states.reserve(links_.size());
  for (const auto& [address, link] : links_) {
    states.push_back(link.state);
  }
  return states;
}

std::map<std::string, DatasetState> AgentRegistry::datasets() const {
  absl::MutexLock lock(&mutex_);
  return datasets_;
}

absl::Status AgentRegistry::WaitUntilReady(absl::Time deadline) {
  constexpr absl::Duration kRetry = absl::Milliseconds(50);
  while (true) {
    {
      absl::MutexLock lock(&mutex_);
      const std::string unreachable = UnreachableAgents();
      const bool has_all = finished_probe_ > 0 && unreachable.empty();
      if (has_all && is_any_complete_) {
        return absl::OkStatus();
      }
      if (absl::Now() >= deadline || is_stopping_) {
        if (!unreachable.empty() || datasets_.empty()) {
          return absl::FailedPreconditionError(unreachable.empty() ? "the agents serve no dataset"
                                                                   : unreachable);
        }
        return datasets_.begin()->second.status;
      }
    }
    ProbeNow(std::min(deadline, absl::Now() + kMaxFrameWait));
    absl::MutexLock lock(&mutex_);
    if (!is_any_complete_) {
      mutex_.AwaitWithDeadline(absl::Condition(&is_stopping_),
                               std::min(deadline, absl::Now() + kRetry));
    }
  }
}

}  // namespace isoscope::server
