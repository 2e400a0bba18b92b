#include "server/cluster/series_state.h"

#include <algorithm>
#include <cstddef>
#include <tuple>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/printable.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "server/cluster/dataset_catalog.h"
#include "wire/field_selection.h"
#include "wire/surface_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using store::ScalarVolumeKey;

// The steps at which a component is offered, ascending.
std::vector<int> OfferedSteps(const SeriesState& series, const wire::FieldPlace& place) {
  std::vector<int> steps;
  for (const auto& [key, id] : series.offered) {
    if (key.field == place.field && key.component == place.component) {
      steps.push_back(key.step);
    }
  }
  return steps;  // keys ascend by step
}

// The agents that have all of `ids`, by shard.
std::map<int, std::vector<const SeriesOwner*>> OwnersOf(
    const SeriesState& series, const std::map<ScalarVolumeKey, std::string>& ids) {
  std::map<int, std::vector<const SeriesOwner*>> with_all;
  for (const auto& [shard, owners] : series.owners) {
    for (const SeriesOwner& owner : owners) {
      const bool has_all = std::all_of(ids.begin(), ids.end(), [&](const auto& wanted) {
        const auto found = owner.volumes.find(wanted.first);
        return found != owner.volumes.end() && found->second == wanted.second;
      });
      if (has_all) {
        with_all[shard].push_back(&owner);
      }
    }
  }
  return with_all;
}

// Shards by the agents that have all of `ids`.
std::vector<ReplicaSet> ReplicaSetsOf(const SeriesState& series,
                                      const std::map<ScalarVolumeKey, std::string>& ids) {
  std::map<int, std::vector<ShardOwner>> owners;
  for (const auto& [shard, with_all] : OwnersOf(series, ids)) {
    for (const SeriesOwner* owner : with_all) {
      owners[shard].push_back({owner->agent, owner->is_draining});
    }
  }
  return GroupByAgents(owners);
}

// The levels that all of `ids` have, and the filter of the drawn volume.
OwnedLevels CommonLevels(const SeriesOwner& owner,
                         const std::map<ScalarVolumeKey, std::string>& ids,
                         const std::string& drawn_id) {
  const auto drawn = owner.levels.find(drawn_id);
  if (drawn == owner.levels.end()) {
    return {};
  }
  OwnedLevels common = drawn->second;
  for (const auto& [key, id] : ids) {
    const auto other = owner.levels.find(id);
    std::erase_if(common.levels, [&](int level) {
      return other == owner.levels.end() ||
             std::find(other->second.levels.begin(), other->second.levels.end(), level) ==
                 other->second.levels.end();
    });
  }
  return common;
}

std::vector<ServedLevel> LevelsOf(const SeriesState& series,
                                  const std::map<ScalarVolumeKey, std::string>& ids,
                                  const std::string& drawn_id) {
  std::map<int, std::vector<LevelOwner>> owners;
  for (const auto& [shard, with_all] : OwnersOf(series, ids)) {
    for (const SeriesOwner* owner : with_all) {
      LevelOwner of_shard{{owner->agent, owner->is_draining}};
      of_shard.owned = CommonLevels(*owner, ids, drawn_id);
      owners[shard].push_back(std::move(of_shard));
    }
  }
  return ServedLevelsOf(owners);
}

// Agents that have one volume of a shard each, but none that has both, can't draw a frame of both.
absl::Status CheckAllShards(const SeriesState& series, const v1::Dataset& dataset,
                            const DatasetState& volume, bool with_all_fields) {
  std::set<int> served;
  for (const ReplicaSet& set : volume.replica_sets) {
    served.insert(set.shard_indices.begin(), set.shard_indices.end());
  }
  for (const auto& [shard, owners] : series.owners) {
    if (served.count(shard) == 0) {
      return absl::UnavailableError(absl::StrCat(
          "dataset \"", dataset.name(), "\": no agent has ",
          with_all_fields ? "all fields" : "both the surfaces' field and that of the colours",
          " for shard ", shard, "; retry when agents have been updated"));
    }
  }
  return absl::OkStatus();
}

// A dataset without fields has one step, which is the first and the last.
absl::Status CheckOnlyVolume(const v1::Dataset& dataset, const v1::FieldSelection& selection) {
  const std::string name = absl::StrCat("dataset \"", dataset.name(), "\"");
  if (!selection.field().empty() || !selection.component().empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "selection.", selection.field().empty() ? "component" : "field", " is ",
        base::Quoted(selection.field().empty() ? selection.component() : selection.field()), ": ",
        name, " has one field, without a name; leave it out"));
  }
  if (selection.when_case() == v1::FieldSelection::kTime) {
    return absl::InvalidArgumentError(
        absl::StrCat("selection.time is ", selection.time(), ": ", name, " has no times"));
  }
  if (selection.when_case() == v1::FieldSelection::kTimeStep && selection.time_step() != 0 &&
      selection.time_step() != -1) {
    return absl::NotFoundError(absl::StrCat("selection.time_step is ", selection.time_step(), ": ",
                                            name, " serves step 0 alone"));
  }
  return absl::OkStatus();
}

absl::Status CheckNoFields(const v1::Dataset& dataset, const v1::FieldSelection* selection,
                           const std::vector<frame::Surface>& surfaces, bool with_all_fields) {
  if (with_all_fields) {
    return absl::InvalidArgumentError(
        absl::StrCat("with_field_values is set: dataset \"", dataset.name(),
                     "\" has one field, whose value on a surface is the isovalue; leave it out"));
  }
  if (selection != nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(CheckOnlyVolume(dataset, *selection));
  }
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    if (surfaces[i].shows_field()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "surfaces[", i, "].color_by.field is ", base::Quoted(surfaces[i].color_by->field),
          ": dataset \"", dataset.name(), "\" has one field"));
    }
  }
  return absl::OkStatus();
}

// "" for a volume without levels, whose digest is as it was before there were levels.
std::string TextOfLevels(const SeriesState& series, const ScalarVolumeKey& key,
                         const std::string& id) {
  const auto& [shard, owners] = *series.owners.begin();
  const bool may_have_levels = std::any_of(
      owners.begin(), owners.end(), [&](const auto& owner) { return owner.levels.count(id) > 0; });
  std::string text;
  if (may_have_levels) {
    for (const ServedLevel& served : LevelsOf(series, key)) {
      absl::StrAppend(&text, " ", served.level, ":", volume::NameOf(served.filter));
    }
  }
  return text;
}

// A digest of the offered volumes of each step, and their levels. O(volumes * shards).
std::map<int, std::string> DigestsOfSteps(const SeriesState& series) {
  std::map<int, std::string> digests;  // first what is digested
  for (const auto& [key, id] : series.offered) {
    absl::StrAppend(&digests[key.step], key.field, " ", key.component, " ", id,
                    TextOfLevels(series, key, id), "\n");
  }
  constexpr std::size_t kDigits = 32;
  for (auto& [step, digest] : digests) {
    digest = base::Sha256Hex(digest).substr(0, kDigits);
  }
  return digests;
}

// The volumes of one step that a frame needs.
class StepVolumes {
 public:
  // All of them outlive the object.
  StepVolumes(const v1::Dataset& description, const SeriesState& series, int step)
      : description_(description), series_(series), step_(step) {}

  // Adds a volume, and returns its dataset id. NOT_FOUND if it is not offered at the step; `path`
  // is the message that names its field.
  absl::StatusOr<std::string> Add(const wire::FieldPlace& place, absl::string_view path) {
    const auto offered =
        series_.offered.find({.field = place.field, .component = place.component, .step = step_});
    if (offered == series_.offered.end()) {
      return absl::NotFoundError(
          absl::StrCat(path, "field is ", base::Quoted(description_.fields(place.field).name()),
                       ": served at steps ", wire::DescribeSteps(OfferedSteps(series_, place)),
                       ", the surfaces are of step ", step_));
    }
    ids_.insert(*offered);
    return offered->second;
  }

  // Returns the ranges of a volume that Add has named.
  [[nodiscard]] v1::FieldComponent RangesAt(const std::string& id) const {
    const auto found = series_.ranges.find(id);
    return found == series_.ranges.end() ? v1::FieldComponent() : found->second;
  }

  [[nodiscard]] const std::map<ScalarVolumeKey, std::string>& ids() const { return ids_; }

 private:
  const v1::Dataset& description_;
  const SeriesState& series_;
  const int step_;
  std::map<ScalarVolumeKey, std::string> ids_;
};

// Adds the volumes that colour surfaces; sets their ranges where they are not.
absl::Status AddColors(const v1::Dataset& description, std::vector<frame::Surface>* surfaces,
                       StepVolumes* volumes, SelectedVolume* selected) {
  for (std::size_t i = 0; i < surfaces->size(); ++i) {
    if (!(*surfaces)[i].shows_field()) {
      continue;
    }
    frame::ColorBy& color_by = *(*surfaces)[i].color_by;
    const std::string path = absl::StrCat("surfaces[", i, "].color_by.");
    ISOSCOPE_ASSIGN_OR_RETURN(
        const wire::FieldPlace place,
        wire::FindField(description, color_by.field, color_by.component, path));
    ISOSCOPE_ASSIGN_OR_RETURN(std::string id, volumes->Add(place, path));
    selected->color_dataset_ids.resize(surfaces->size());
    selected->color_dataset_ids[i] = std::move(id);
    if (!color_by.range.has_value()) {
      const bool is_of_step = color_by.range_source == frame::RangeSource::kStep;
      ISOSCOPE_ASSIGN_OR_RETURN(
          color_by.range,
          wire::ColorRangeOf(is_of_step
                                 ? volumes->RangesAt(selected->color_dataset_ids[i])
                                 : description.fields(place.field).components(place.component),
                             absl::StrCat(path, "range")));
    }
  }
  return absl::OkStatus();
}

absl::Status AddAllFields(const v1::Dataset& description, StepVolumes* volumes,
                          SelectedVolume* selected) {
  for (int i = 0; i < description.fields_size(); ++i) {
    const v1::Field& field = description.fields(i);
    for (int component = 0; component < field.components_size(); ++component) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::string id, volumes->Add({.field = i, .component = component},
                                                             "with_field_values: "));
      selected->all_fields.push_back({.field = field.name(),
                                      .component = field.components(component).name(),
                                      .unit = field.unit(),
                                      .dataset_id = std::move(id)});
    }
  }
  return absl::OkStatus();
}

// Returns the state of a dataset of one volume, without its agents.
DatasetState StateOfVolume(const DatasetState& dataset, const wire::FieldPlace& place,
                           const std::string& id) {
  DatasetState state;
  v1::Dataset& of_volume = state.dataset;
  of_volume = dataset.dataset;
  of_volume.set_dataset_id(id);
  of_volume.clear_fields();
  of_volume.clear_time_steps();
  of_volume.clear_levels();  // DatasetState has them
  const v1::FieldComponent& component =
      dataset.dataset.fields(place.field).components(place.component);
  of_volume.set_sample_type(component.sample_type());
  of_volume.clear_value_range();
  if (component.has_value_range()) {
    *of_volume.mutable_value_range() = component.value_range();
  }
  of_volume.clear_finite_range();
  if (component.has_finite_range()) {
    *of_volume.mutable_finite_range() = component.finite_range();
  }
  of_volume.clear_max_gradient_magnitude();
  if (component.has_max_gradient_magnitude()) {
    of_volume.set_max_gradient_magnitude(component.max_gradient_magnitude());
  }
  state.status = dataset.status;
  state.picture_revision = dataset.picture_revision;
  state.is_served = dataset.is_served;
  return state;
}

}  // namespace

SeriesState MakeSeriesState(std::map<int, std::vector<SeriesOwner>> owners) {
  struct Votes {
    std::set<int> shards;
    int agents = 0;
  };
  std::map<ScalarVolumeKey, std::map<std::string, Votes>> votes;
  for (const auto& [shard, of_shard] : owners) {
    for (const SeriesOwner& owner : of_shard) {
      for (const auto& [key, id] : owner.volumes) {
        Votes& of_id = votes[key][id];
        of_id.shards.insert(shard);
        ++of_id.agents;
      }
    }
  }
  SeriesState series;
  for (const auto& [key, by_id] : votes) {
    int most = 0;
    for (const auto& [id, of_id] : by_id) {
      if (of_id.shards.size() == owners.size() && of_id.agents > most) {
        most = of_id.agents;
        series.offered[key] = id;
      }
    }
  }
  series.owners = std::move(owners);
  return series;
}

std::vector<ServedLevel> LevelsOf(const SeriesState& series, const ScalarVolumeKey& key) {
  const auto offered = series.offered.find(key);
  if (offered == series.offered.end()) {
    return {};
  }
  return LevelsOf(series, {*offered}, offered->second);
}

v1::FieldComponent RangesOf(const isoscope::internal::v1::VolumeDescription& volume) {
  v1::FieldComponent ranges;
  if (volume.has_value_range()) {
    *ranges.mutable_value_range() = volume.value_range();
  }
  if (volume.has_finite_range()) {
    *ranges.mutable_finite_range() = volume.finite_range();
  }
  if (volume.has_max_gradient_magnitude()) {
    ranges.set_max_gradient_magnitude(volume.max_gradient_magnitude());
  }
  return ranges;
}

v1::Dataset JoinDescriptions(const std::vector<const v1::Dataset*>& datasets,
                             const SeriesState& series) {
  const v1::Dataset* const longest = *std::max_element(
      datasets.begin(), datasets.end(),
      [](const auto* a, const auto* b) { return a->time_steps_size() < b->time_steps_size(); });
  v1::Dataset joined = *longest;
  const std::map<int, std::string> offered_steps = DigestsOfSteps(series);
  std::vector<std::set<int>> of_fields(static_cast<std::size_t>(joined.fields_size()));
  for (const auto& [key, id] : series.offered) {
    if (key.field < joined.fields_size()) {
      of_fields[static_cast<std::size_t>(key.field)].insert(key.step);
    }
  }
  joined.clear_time_steps();
  std::map<int, int> index_of;  // of offered steps, in the joined description
  for (const v1::TimeStep& step : longest->time_steps()) {
    if (const auto offered = offered_steps.find(step.number()); offered != offered_steps.end()) {
      index_of[step.number()] = joined.time_steps_size();
      *joined.add_time_steps() = step;
      joined.mutable_time_steps()->rbegin()->set_volumes_digest(offered->second);
    }
  }
  for (int i = 0; i < joined.fields_size(); ++i) {
    joined.mutable_fields(i)->clear_time_steps();
    for (const int step : of_fields[static_cast<std::size_t>(i)]) {
      if (const auto index = index_of.find(step); index != index_of.end()) {
        joined.mutable_fields(i)->add_time_steps(index->second);
      }
    }
  }
  return joined;
}

absl::StatusOr<SelectedVolume> SelectVolume(const std::shared_ptr<const DatasetState>& dataset,
                                            const v1::FieldSelection* selection,
                                            std::vector<frame::Surface>* surfaces,
                                            bool with_all_fields) {
  SelectedVolume selected;
  const v1::Dataset& description = dataset->dataset;
  if (dataset->series == nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(CheckNoFields(description, selection, *surfaces, with_all_fields));
    selected.dataset = dataset;
    selected.at_step = wire::RangesOf(description);
    return selected;
  }
  const SeriesState& series = *dataset->series;
  const v1::FieldSelection asked = selection != nullptr ? *selection : v1::FieldSelection();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const wire::FieldPlace place,
      wire::FindField(description, asked.field(), asked.component(), "selection."));
  ISOSCOPE_ASSIGN_OR_RETURN(const int step,
                            wire::ChooseStep(description, asked, OfferedSteps(series, place)));
  StepVolumes volumes(description, series, step);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string id, volumes.Add(place, "selection."));
  ISOSCOPE_RETURN_IF_ERROR(AddColors(description, surfaces, &volumes, &selected));
  if (with_all_fields) {
    ISOSCOPE_RETURN_IF_ERROR(AddAllFields(description, &volumes, &selected));
  }
  const auto volume = std::make_shared<DatasetState>(StateOfVolume(*dataset, place, id));
  volume->replica_sets = ReplicaSetsOf(series, volumes.ids());
  volume->levels = LevelsOf(series, volumes.ids(), id);
  ISOSCOPE_RETURN_IF_ERROR(CheckAllShards(series, description, *volume, with_all_fields));
  selected.dataset = volume;
  selected.at_step = volumes.RangesAt(id);

  const v1::Field& field = description.fields(place.field);
  v1::FieldSelection& used = selected.selection.emplace();
  used.set_field(field.name());
  used.set_component(field.components(place.component).name());
  used.set_time_step(step);
  selected.time = wire::TimeOf(description, step);
  return selected;
}

}  // namespace isoscope::server
