#include "server/dataset_catalog.h"

#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::internal::v1;

// A message names this many shards, and then says "...".
constexpr std::size_t kMaxNamedShards = 16;

std::string Identity(const v1::ShardDescription& shard) {
  return absl::StrFormat("id %s, %d shards, manifest crc32c %08x, range table crc32c %08x",
                         shard.dataset().dataset_id(), shard.dataset().shard_count(),
                         shard.manifest_crc32c(), shard.range_table_crc32c());
}

// Returns the first error in an agent's answer.
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

// One dataset, while DatasetsOf goes through the agents.
struct Draft {
  const v1::ShardDescription* reference = nullptr;
  std::string reference_address;
  bool is_reference_served = false;
  std::string contradiction;
  std::map<int, const AgentState*> owners;  // of shards that are served
};

void AddToDraft(const AgentState& agent, const v1::ShardDescription& shard, Draft* draft) {
  const bool is_served = agent.status.ok();
  // An agent that answers is the reference. A lost agent only shows that there is such a dataset.
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

// Checks that all agents of a dataset draw the same pixels.
absl::Status CheckRevisions(const std::string& name, const Draft& draft) {
  const AgentState& first = *draft.owners.begin()->second;
  for (const auto& [shard, owner] : draft.owners) {
    if (!(owner->picture_revision == first.picture_revision)) {
      return absl::FailedPreconditionError(absl::StrCat(
          "dataset \"", name, "\": agents would draw different pictures: agent ", first.address,
          " has picture revision ", frame::ToString(first.picture_revision), ", agent ",
          owner->address, " has ", frame::ToString(owner->picture_revision),
          "; run one version with one --renderer on all of them"));
    }
  }
  return absl::OkStatus();
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
  state.status = CheckRevisions(name, draft);
  if (!state.status.ok()) {
    return state;
  }
  state.picture_revision = draft.owners.begin()->second->picture_revision;
  // Owners are in the order of their first shards, so their order does not depend on addresses.
  std::map<const AgentState*, std::size_t> agent_index_of;
  for (const auto& [shard, owner] : draft.owners) {
    const auto [entry, is_new] = agent_index_of.emplace(owner, state.agents.size());
    if (is_new) {
      state.agents.push_back({owner->address, owner->channel, {}});
    }
    state.agents[entry->second].shard_indices.push_back(shard);
  }
  return state;
}

}  // namespace

void AdoptAnswer(absl::StatusOr<v1::DescribeShardsResponse> answer, AgentState* agent) {
  if (!answer.ok()) {
    agent->status = std::move(answer).status();
    return;
  }
  agent->version = answer->version();
  agent->renderer = answer->renderer();
  agent->load.reset();
  if (answer->has_load()) {
    agent->load = answer->load();
  }
  absl::StatusOr<frame::PictureRevision> revision =
      rpc::PictureRevisionFromProto(answer->picture_revision(), "picture_revision");
  absl::Status status = Validate(*answer);
  status.Update(revision.status());
  if (!status.ok()) {
    agent->status = std::move(status);
    agent->shards.clear();
    return;
  }
  agent->picture_revision = *std::move(revision);
  agent->status = absl::OkStatus();
  agent->shards.assign(answer->shards().begin(), answer->shards().end());
}

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

std::map<std::string, DatasetState> DatasetsFor(
    const Caller& caller, const std::map<std::string, DatasetState>& datasets) {
  if (caller.sees_all_datasets()) {
    return datasets;
  }
  std::map<std::string, DatasetState> visible;
  for (const auto& [name, state] : datasets) {
    if (caller.MaySee(name)) {
      visible.emplace(name, state);
    }
  }
  return visible;
}

absl::StatusOr<DatasetState> FindDataset(const std::map<std::string, DatasetState>& datasets,
                                         const std::string& name, const std::string& unreachable,
                                         const Caller& caller) {
  if (!caller.sees_all_datasets()) {
    return FindDataset(DatasetsFor(caller, datasets), name, unreachable);
  }
  if (name.empty() && datasets.size() == 1) {
    return datasets.begin()->second;
  }
  const auto found = datasets.find(name);
  if (found != datasets.end()) {
    return found->second;
  }
  const std::string suffix = unreachable.empty() ? "" : absl::StrCat("; ", unreachable);
  const std::string known =
      datasets.empty()
          ? "no dataset is served"
          : absl::StrCat("there are: ",
                         absl::StrJoin(datasets, ", ", [](std::string* out, const auto& entry) {
                           absl::StrAppend(out, "\"", entry.first, "\"");
                         }));
  if (!name.empty()) {
    return absl::NotFoundError(absl::StrCat("dataset \"", name, "\": ", known, suffix));
  }
  if (datasets.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(known, suffix));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("dataset is empty: must name one of several; ", known));
}

}  // namespace isoscope::server
