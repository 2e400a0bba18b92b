// DatasetsOf goes through the agents' shards and builds a state for each name:
//
//   Draft     one name: its contents, by identity (id, number of shards, checksums)
//   Content   one content: its served shards, and its crews
//   Crew      the agents of one picture revision, with the shards that they own
//
// Then Complete chooses: the content of most agents, the best crew of it, and the replica sets of
// the crew. The error of an incomplete dataset names what is missing: shards, agreement or a
// revision.

#include "server/cluster/dataset_catalog.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <set>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

#include "core/base/error_reason.h"
#include "core/base/printable.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/volume/volume_level.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"
#include "wire/series_convert.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// A message names at most this many shards, followed by "...".
constexpr std::size_t kMaxNamedShards = 16;

std::string Identity(const internal::ShardDescription& shard) {
  return absl::StrFormat("id %s, %d shards, manifest crc32c %08x, range table crc32c %08x",
                         shard.dataset().dataset_id(), shard.dataset().shard_count(),
                         shard.manifest_crc32c(), shard.range_table_crc32c());
}

// INVALID_ARGUMENT if a volume is of no field, component or step of its dataset.
absl::Status ValidateVolumes(const internal::ShardDescription& shard, const std::string& path) {
  const isoscope::v1::Dataset& dataset = shard.dataset();
  const int step_count = std::max(dataset.time_steps_size(), 1);
  for (int i = 0; i < dataset.fields_size(); ++i) {
    if (dataset.fields(i).components().empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ".dataset.fields[", i, "].components is empty: must have one"));
    }
  }
  for (int i = 0; i < shard.volumes_size(); ++i) {
    const store::ScalarVolumeKey key = wire::KeyOf(shard.volumes(i));
    if (key.field < 0 || key.field >= dataset.fields_size() || key.component < 0 ||
        key.component >= dataset.fields(key.field).components_size() || key.step < 0 ||
        key.step >= step_count) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, ".volumes[", i, "] is field ", key.field, ", component ", key.component, ", step ",
          key.step, ": dataset \"", dataset.name(), "\" has no such volume"));
    }
  }
  return absl::OkStatus();
}

// INVALID_ARGUMENT unless the levels are ascending ones of the dataset's grid.
absl::Status ValidateLevels(const internal::LevelsDescription& proto,
                            const isoscope::v1::Dataset& dataset, const std::string& path) {
  const isoscope::v1::Dimensions& dims = dataset.geometry().sample_dims();
  const int highest = volume::HighestLevel({dims.x(), dims.y(), dims.z()});
  for (int i = 0; i < proto.levels_size(); ++i) {
    const std::int32_t least = i == 0 ? 1 : proto.levels(i - 1) + 1;
    if (proto.levels(i) < least || proto.levels(i) > highest) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".levels.levels[", i, "] is ",
                                                     proto.levels(i),
                                                     ": must be ascending, from 1 to ", highest));
    }
  }
  const bool is_known = proto.filter() == isoscope::v1::DatasetLevel::FILTER_MEAN ||
                        proto.filter() == isoscope::v1::DatasetLevel::FILTER_MAJORITY;
  if (!proto.levels().empty() && !is_known) {
    return absl::InvalidArgumentError(absl::StrCat(path, ".levels.filter is ",
                                                   static_cast<int>(proto.filter()),
                                                   ": must be 1 (mean) or 2 (majority)"));
  }
  return absl::OkStatus();
}

absl::Status ValidateLevels(const internal::ShardDescription& shard, const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(ValidateLevels(shard.levels(), shard.dataset(), path));
  for (int i = 0; i < shard.volumes_size(); ++i) {
    ISOSCOPE_RETURN_IF_ERROR(ValidateLevels(shard.volumes(i).levels(), shard.dataset(),
                                            absl::StrCat(path, ".volumes[", i, "]")));
  }
  return absl::OkStatus();
}

// REQUIRES: they are valid.
OwnedLevels LevelsFromProto(const internal::LevelsDescription& proto) {
  OwnedLevels owned;
  owned.levels.assign(proto.levels().begin(), proto.levels().end());
  owned.filter = proto.filter() == isoscope::v1::DatasetLevel::FILTER_MAJORITY
                     ? volume::LevelFilter::kMajority
                     : volume::LevelFilter::kMean;
  return owned;
}

// Clients and coordinators ask again after this time while agents open their shards.
constexpr absl::Duration kOpeningDelay = absl::Seconds(1);

absl::Status OpeningError(absl::string_view message) {
  return base::WithReason(base::WithRetryDelay(absl::UnavailableError(message), kOpeningDelay),
                          base::ErrorReason::kAgentOpening);
}

std::string ToString(const isoscope::v1::OpeningProgress& progress) {
  constexpr double kMiB = 1 << 20;
  return absl::StrFormat("%d of %d shards are open, %.1f MiB of %.1f MiB of tables are read",
                         progress.open_shard_count(), progress.shard_count(),
                         static_cast<double>(progress.read_bytes()) / kMiB,
                         static_cast<double>(progress.table_bytes()) / kMiB);
}

// Returns the first error in an agent's answer.
absl::Status Validate(const internal::DescribeShardsResponse& response) {
  for (int i = 0; i < response.shards_size(); ++i) {
    const internal::ShardDescription& shard = response.shards(i);
    const std::string path = absl::StrCat("shards[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(wire::Validate(shard.dataset(), absl::StrCat(path, ".dataset")));
    if (shard.shard_index() < 0 || shard.shard_index() >= shard.dataset().shard_count()) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".shard_index is ", shard.shard_index(),
                                                     ": must lie in [0, ",
                                                     shard.dataset().shard_count(), ")"));
    }
    ISOSCOPE_RETURN_IF_ERROR(ValidateVolumes(shard, path));
    ISOSCOPE_RETURN_IF_ERROR(ValidateLevels(shard, path));
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

// The agents that have one picture revision.
struct Crew {
  std::map<int, std::vector<const AgentState*>> owners;  // of shards; by address
  std::set<const AgentState*> agents;
};

// The agents that have one content.
struct Content {
  const internal::ShardDescription* reference = nullptr;  // the first one
  const AgentState* first = nullptr;                      // a served one before a lost one
  int agent_count = 0;                                    // also lost ones
  std::set<int> served_shards;
  std::map<std::string, Crew> crews;  // by revision; only of agents that answer
};

// One dataset, while DatasetsOf goes through the agents.
struct Draft {
  std::map<std::string, Content> contents;  // by identity
};

void AddToDraft(const AgentState& agent, const internal::ShardDescription& shard,
                std::set<const Content*>* counted, Draft* draft) {
  const bool is_served = agent.status.ok();
  Content& content = draft->contents[Identity(shard)];
  if (content.first == nullptr || (is_served && !content.first->status.ok())) {
    content.reference = &shard;
    content.first = &agent;
  }
  if (counted->insert(&content).second) {
    ++content.agent_count;
  }
  if (is_served) {
    content.served_shards.insert(shard.shard_index());
    Crew& crew = content.crews[frame::ToString(agent.picture_revision)];
    crew.owners[shard.shard_index()].push_back(&agent);
    crew.agents.insert(&agent);
  }
}

bool HasAllShards(const Content& content, std::size_t shard_count) {
  return shard_count == static_cast<std::size_t>(content.reference->dataset().shard_count());
}

// Returns "agent A serves ...; agent B serves ...", of the first agents of two contents that are
// served; "" if there is only one.
std::string ContradictionOf(const Draft& draft) {
  std::vector<const Content*> served;
  for (const auto& [identity, content] : draft.contents) {
    if (!content.crews.empty()) {
      served.push_back(&content);
    }
  }
  if (served.size() < 2) {
    return "";
  }
  std::sort(served.begin(), served.end(), [](const Content* a, const Content* b) {
    return a->first->address < b->first->address;
  });
  return absl::StrCat("agent ", served[0]->first->address, " serves ",
                      Identity(*served[0]->reference), "; agent ", served[1]->first->address,
                      " serves ", Identity(*served[1]->reference));
}

// Returns the content that stands for the dataset; null if that is not clear.
const Content* ChooseContent(const Draft& draft) {
  const Content* most = nullptr;
  const Content* only_served = nullptr;
  int served_count = 0;
  bool is_tie = false;
  for (const auto& [identity, content] : draft.contents) {
    if (!content.crews.empty()) {
      only_served = &content;
      ++served_count;
    }
    if (most == nullptr || content.agent_count >= most->agent_count) {
      is_tie = most != nullptr && content.agent_count == most->agent_count;
      most = &content;
    }
  }
  if (draft.contents.size() == 1 || served_count == 0) {
    return most;
  }
  // Lost agents may come back or not. So they count only against contents with fewer agents.
  if (served_count == 1 && (is_tie || most == only_served)) {
    return only_served;
  }
  return !is_tie && HasAllShards(*most, most->served_shards.size()) ? most : nullptr;
}

// Returns the revision to draw with: a complete one if there is one. Null if no agent answers.
const Crew* ChooseCrew(const Content& content) {
  const Crew* best = nullptr;
  const auto rank_of = [&](const Crew& crew) {
    const frame::PictureRevision& revision = (*crew.agents.begin())->picture_revision;
    return std::tuple(HasAllShards(content, crew.owners.size()),
                      HasAllShards(content, crew.owners.size()) ? 0 : crew.owners.size(),
                      crew.agents.size(), revision.number);
  };
  for (const auto& [revision, crew] : content.crews) {
    if (best == nullptr || rank_of(crew) > rank_of(*best)) {
      best = &crew;
    }
  }
  return best;
}

std::vector<ReplicaSet> ReplicaSetsOf(const Crew& crew) {
  std::vector<ReplicaSet> sets;
  std::map<std::vector<const AgentState*>, std::size_t> set_of;
  for (const auto& [shard, owners] : crew.owners) {
    const auto [entry, is_new] = set_of.emplace(owners, sets.size());
    if (is_new) {
      ReplicaSet set;
      const bool all_drain = std::all_of(
          owners.begin(), owners.end(), [](const AgentState* owner) { return owner->is_draining; });
      for (const AgentState* owner : owners) {
        if (all_drain || !owner->is_draining) {
          set.agents.push_back({owner->address, owner->channel, owner->export_channel});
        }
      }
      sets.push_back(std::move(set));
    }
    sets[entry->second].shard_indices.push_back(shard);
  }
  return sets;
}

// The error of a dataset whose shards are all served, but by agents of several revisions.
absl::Status RevisionError(const std::string& name, const Content& content) {
  const AgentState& first = **content.crews.begin()->second.agents.begin();
  const AgentState& other = **content.crews.rbegin()->second.agents.begin();
  return absl::FailedPreconditionError(
      absl::StrCat("dataset \"", name, "\": agents would draw different pictures: agent ",
                   first.address, " has picture revision ", frame::ToString(first.picture_revision),
                   ", agent ", other.address, " has ", frame::ToString(other.picture_revision),
                   "; run one version with one --renderer on agents that serve all shards"));
}

// Calls `visit` for each shard of the dataset that an agent of the crew has.
template <typename Visit>
void ForEachShardOf(const Crew& crew, const isoscope::v1::Dataset& dataset, const Visit& visit) {
  for (const auto& [index, agents] : crew.owners) {
    for (const AgentState* agent : agents) {
      for (const internal::ShardDescription& shard : agent->shards) {
        if (shard.shard_index() == index && shard.dataset().name() == dataset.name() &&
            shard.dataset().dataset_id() == dataset.dataset_id()) {
          visit(*agent, shard);
        }
      }
    }
  }
}

// The levels of a dataset without fields.
std::vector<ServedLevel> LevelsOf(const Crew& crew, const isoscope::v1::Dataset& dataset) {
  std::map<int, std::vector<LevelOwner>> owners;
  ForEachShardOf(
      crew, dataset, [&](const AgentState& agent, const internal::ShardDescription& shard) {
        LevelOwner owner{{{agent.address, agent.channel, agent.export_channel}, agent.is_draining}};
        owner.owned = LevelsFromProto(shard.levels());
        owners[shard.shard_index()].push_back(std::move(owner));
      });
  return ServedLevelsOf(owners);
}

// The shards of a series with the agents of a crew, the descriptions that these give of it, and the
// ranges of its volumes by id.
std::map<int, std::vector<SeriesOwner>> SeriesOwnersOf(
    const Crew& crew, const isoscope::v1::Dataset& dataset,
    std::vector<const isoscope::v1::Dataset*>* descriptions,
    std::map<std::string, isoscope::v1::FieldComponent>* ranges) {
  std::map<int, std::vector<SeriesOwner>> owners;
  ForEachShardOf(crew, dataset,
                 [&](const AgentState& agent, const internal::ShardDescription& shard) {
                   SeriesOwner& owner = owners[shard.shard_index()].emplace_back();
                   owner.agent = {agent.address, agent.channel, agent.export_channel};
                   owner.is_draining = agent.is_draining;
                   for (const internal::VolumeDescription& volume : shard.volumes()) {
                     owner.volumes.emplace(wire::KeyOf(volume), volume.dataset_id());
                     if (!volume.levels().levels().empty()) {
                       owner.levels.emplace(volume.dataset_id(), LevelsFromProto(volume.levels()));
                     }
                     if (ranges->count(volume.dataset_id()) == 0) {
                       ranges->emplace(volume.dataset_id(), RangesOf(volume));
                     }
                   }
                   descriptions->push_back(&shard.dataset());
                 });
  return owners;
}

// The levels of the default field at its last step that is offered.
std::vector<ServedLevel> LevelsOfDefault(const SeriesState& series,
                                         const isoscope::v1::Dataset& dataset) {
  store::ScalarVolumeKey last{.field = 0, .component = dataset.fields(0).components_size() - 1};
  for (const auto& [key, id] : series.offered) {
    if (key.field == last.field && key.component == last.component) {
      last.step = std::max(last.step, key.step);
    }
  }
  return LevelsOf(series, last);
}

// Adds the volumes of a dataset that has fields.
void CompleteSeries(const Crew& crew, DatasetState* state) {
  std::vector<const isoscope::v1::Dataset*> descriptions;
  std::map<std::string, isoscope::v1::FieldComponent> ranges;
  auto series = std::make_shared<SeriesState>(
      MakeSeriesState(SeriesOwnersOf(crew, state->dataset, &descriptions, &ranges)));
  series->ranges = std::move(ranges);
  if (!descriptions.empty()) {
    const auto missing = state->dataset.missing_shards();
    state->dataset = JoinDescriptions(descriptions, *series);
    *state->dataset.mutable_missing_shards() = missing;
    AddLevels(LevelsOfDefault(*series, state->dataset), &state->dataset);
  }
  state->series = std::move(series);
}

DatasetState Complete(const std::string& name, const Draft& draft, absl::string_view unreachable) {
  DatasetState state;
  state.contradiction = ContradictionOf(draft);
  const Content* const content = ChooseContent(draft);
  if (content == nullptr) {
    state.is_served = true;
    const auto served = std::find_if(draft.contents.begin(), draft.contents.end(),
                                     [](const auto& entry) { return !entry.second.crews.empty(); });
    state.dataset = served->second.reference->dataset();
    for (int shard = 0; shard < state.dataset.shard_count(); ++shard) {
      state.dataset.add_missing_shards(shard);
    }
    state.status = absl::FailedPreconditionError(absl::StrCat(
        "dataset \"", name, "\": agents contradict each other: ",
        state.contradiction.empty() ? absl::StrCat("most of them are lost; ", unreachable)
                                    : state.contradiction,
        "; serve shards of one `isoscope partition` run"));
    return state;
  }
  state.dataset = content->reference->dataset();
  state.is_served = !content->crews.empty();
  std::vector<int> missing;
  for (int shard = 0; shard < state.dataset.shard_count(); ++shard) {
    if (content->served_shards.count(shard) == 0) {
      missing.push_back(shard);
      state.dataset.add_missing_shards(shard);
    }
  }
  const Crew* const crew = ChooseCrew(*content);
  if (crew != nullptr) {
    state.replica_sets = ReplicaSetsOf(*crew);
    state.picture_revision = (*crew->agents.begin())->picture_revision;
    if (!state.dataset.fields().empty()) {
      CompleteSeries(*crew, &state);
    } else {
      state.levels = LevelsOf(*crew, state.dataset);
      AddLevels(state.levels, &state.dataset);
    }
  }
  if (!missing.empty()) {
    state.status = absl::FailedPreconditionError(absl::StrCat(
        "dataset \"", name, "\": ", missing.size() == 1 ? "shard " : "shards ", JoinShards(missing),
        " of ", state.dataset.shard_count(), " not served by any agent; ",
        unreachable.empty() ? "all agents answer: start agents for them" : unreachable));
  } else if (!HasAllShards(*content, crew->owners.size())) {
    state.status = RevisionError(name, *content);
  }
  return state;
}

}  // namespace

void AdoptAnswer(absl::StatusOr<internal::DescribeShardsResponse> answer, AgentState* agent) {
  agent->is_draining = false;
  agent->opening.reset();
  agent->opening_datasets.clear();
  agent->damaged_shards.clear();
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
      wire::PictureRevisionFromProto(answer->picture_revision(), "picture_revision");
  absl::Status status = Validate(*answer);
  status.Update(revision.status());
  if (!status.ok()) {
    agent->status = std::move(status);
    agent->shards.clear();
    return;
  }
  agent->picture_revision = *std::move(revision);
  if (answer->has_opening()) {  // its shards are those of its last answer, as of a lost agent
    agent->status = OpeningError(ToString(answer->opening()));
    agent->opening = answer->opening();
    agent->opening_datasets.insert(answer->opening_datasets().begin(),
                                   answer->opening_datasets().end());
    return;
  }
  agent->status = absl::OkStatus();
  agent->damaged_shards.assign(answer->damaged_shards().begin(), answer->damaged_shards().end());
  agent->is_draining = answer->is_draining();
  agent->shards.assign(answer->shards().begin(), answer->shards().end());
}

std::map<std::string, DatasetState> DatasetsOf(const std::vector<AgentState>& agents) {
  std::map<std::string, Draft> drafts;
  for (const AgentState& agent : agents) {
    std::set<const Content*> counted;
    for (const internal::ShardDescription& shard : agent.shards) {
      AddToDraft(agent, shard, &counted, &drafts[shard.dataset().name()]);
    }
  }
  const std::string unreachable = DescribeUnreachable(agents);
  const std::set<std::string> opening = OpeningDatasets(agents);
  std::map<std::string, DatasetState> datasets;
  for (const auto& [name, draft] : drafts) {
    DatasetState state = Complete(name, draft, unreachable);
    if (!state.dataset.missing_shards().empty() && opening.count(name) > 0) {
      state.status = OpeningError(state.status.message());
    } else if (!state.status.ok()) {
      state.status = base::WithReason(state.status, base::ErrorReason::kDatasetIncomplete);
    }
    datasets.emplace(name, std::move(state));
  }
  return datasets;
}

void RemoveAgents(const std::set<std::string>& addresses, std::vector<ReplicaSet>* sets) {
  for (ReplicaSet& set : *sets) {
    std::erase_if(set.agents,
                  [&](const ServingAgent& agent) { return addresses.count(agent.address) > 0; });
  }
  std::erase_if(*sets, [](const ReplicaSet& set) { return set.agents.empty(); });
}

std::string DescribeUnreachable(const std::vector<AgentState>& agents) {
  std::vector<std::string> lost;
  std::vector<std::string> opening;
  for (const AgentState& agent : agents) {
    if (!agent.status.ok()) {
      (agent.opening.has_value() ? opening : lost)
          .push_back(absl::StrCat(agent.address, " (", agent.status.message(), ")"));
    }
  }
  std::vector<std::string> parts;
  if (!lost.empty()) {
    parts.push_back(absl::StrCat("agents that can't be reached: ", absl::StrJoin(lost, ", ")));
  }
  if (!opening.empty()) {
    parts.push_back(
        absl::StrCat("agents that are opening their shards: ", absl::StrJoin(opening, ", ")));
  }
  return absl::StrJoin(parts, "; ");
}

std::set<std::string> OpeningDatasets(const std::vector<AgentState>& agents) {
  std::set<std::string> names;
  for (const AgentState& agent : agents) {
    names.insert(agent.opening_datasets.begin(), agent.opening_datasets.end());
  }
  return names;
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

absl::StatusOr<const DatasetState*> FindDataset(const std::map<std::string, DatasetState>& datasets,
                                                const std::string& name,
                                                const std::string& unreachable,
                                                const Caller& caller,
                                                const std::set<std::string>& opening) {
  if (!name.empty() && caller.MaySee(name)) {
    const auto found = datasets.find(name);
    if (found != datasets.end()) {
      return &found->second;
    }
  }
  std::vector<absl::string_view> visible;
  const DatasetState* last = nullptr;
  for (const auto& [known, state] : datasets) {
    if (caller.MaySee(known)) {
      visible.push_back(known);
      last = &state;
    }
  }
  if (name.empty() && visible.size() == 1) {
    return last;
  }
  const std::string suffix = unreachable.empty() ? "" : absl::StrCat("; ", unreachable);
  const std::string known =
      visible.empty() ? "no dataset is served"
                      : absl::StrCat("there are: ",
                                     absl::StrJoin(visible, ", ",
                                                   [](std::string* out, absl::string_view entry) {
                                                     absl::StrAppend(out, "\"", entry, "\"");
                                                   }));
  const bool is_opening = name.empty()
                              ? visible.empty() && std::any_of(opening.begin(), opening.end(),
                                                               [&](const std::string& of_agents) {
                                                                 return caller.MaySee(of_agents);
                                                               })
                              : caller.MaySee(name) && opening.count(name) > 0;
  if (is_opening) {
    return OpeningError(name.empty()
                            ? unreachable
                            : absl::StrCat("dataset ", base::Quoted(name), ": ", unreachable));
  }
  if (!name.empty()) {
    return absl::NotFoundError(absl::StrCat("dataset ", base::Quoted(name), ": ", known, suffix));
  }
  if (visible.empty()) {
    return base::WithReason(absl::FailedPreconditionError(absl::StrCat(known, suffix)),
                            base::ErrorReason::kDatasetIncomplete);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("dataset is empty: must name one of several; ", known));
}

absl::Status CheckDatasetId(const isoscope::v1::Dataset& dataset, absl::string_view expected) {
  if (expected.empty() || expected == dataset.dataset_id()) {
    return absl::OkStatus();
  }
  return base::WithReason(
      absl::FailedPreconditionError(
          absl::StrCat("dataset \"", dataset.name(), "\" has dataset_id ", dataset.dataset_id(),
                       ", the request expects ", base::Quoted(expected),
                       ": the agents serve other contents under this name; ask GetDataset which")),
      base::ErrorReason::kDatasetIdDiffers);
}

}  // namespace isoscope::server
