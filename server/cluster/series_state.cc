#include "server/cluster/series_state.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/error_reason.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "server/cluster/dataset_catalog.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using store::ScalarVolumeKey;

// A message names this many steps, and then says "...".
constexpr std::size_t kMaxNamedSteps = 16;

std::string Quoted(const std::string& text) {
  constexpr std::size_t kMaxBytes = 100;
  return absl::StrCat("\"", absl::CHexEscape(text.substr(0, kMaxBytes)), "\"");
}

template <typename Named>
std::string JoinNames(const google::protobuf::RepeatedPtrField<Named>& named) {
  return absl::StrJoin(named, ", ", [](std::string* out, const Named& one) {
    absl::StrAppend(out, "\"", one.name(), "\"");
  });
}

// Indices of a field and a component.
struct FieldPlace {
  int field = 0;
  int component = 0;
};

// `path` names the message in errors.
absl::StatusOr<FieldPlace> FindField(const v1::Dataset& dataset, const std::string& field,
                                     const std::string& component, const std::string& path) {
  FieldPlace place;
  if (!field.empty()) {
    const auto found = std::find_if(dataset.fields().begin(), dataset.fields().end(),
                                    [&](const v1::Field& of) { return of.name() == field; });
    if (found == dataset.fields().end()) {
      return absl::InvalidArgumentError(absl::StrCat(path, "field is ", Quoted(field),
                                                     ": dataset \"", dataset.name(), "\" has ",
                                                     JoinNames(dataset.fields())));
    }
    place.field = static_cast<int>(found - dataset.fields().begin());
  }
  const v1::Field& chosen = dataset.fields(place.field);
  place.component = chosen.components_size() - 1;  // the only one, or the magnitude
  if (component.empty()) {
    return place;
  }
  // A number names a component, too.
  for (int i = 0; i < chosen.components_size(); ++i) {
    const std::string& name = chosen.components(i).name();
    const bool is_own = name != store::kMagnitudeName;
    if (name == component ||
        (is_own && chosen.components_size() > 1 && component == absl::StrCat(i))) {
      place.component = i;
      return place;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, "component is ", Quoted(component), ": field \"", chosen.name(), "\" has ",
                   chosen.components_size() == 1 ? "one component, without a name"
                                                 : JoinNames(chosen.components())));
}

// The steps at which a component is offered, ascending.
std::vector<int> StepsOf(const SeriesState& series, const FieldPlace& place) {
  std::vector<int> steps;
  for (const auto& [key, id] : series.offered) {
    if (key.field == place.field && key.component == place.component) {
      steps.push_back(key.step);
    }
  }
  return steps;  // keys ascend by step
}

std::string DescribeSteps(const std::vector<int>& steps) {
  if (steps.empty()) {
    return "none";
  }
  if (static_cast<std::size_t>(steps.back() - steps.front()) + 1 == steps.size()) {
    return steps.size() == 1 ? absl::StrCat(steps.front())
                             : absl::StrCat(steps.front(), " to ", steps.back());
  }
  const std::size_t named = std::min(steps.size(), kMaxNamedSteps);
  return absl::StrCat(
      absl::StrJoin(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(named), ", "),
      named < steps.size() ? absl::StrCat(", ... (", steps.size(), " in all)") : "");
}

// The time of a step; not set if the dataset has no times.
std::optional<double> TimeOf(const v1::Dataset& dataset, int step) {
  for (const v1::TimeStep& time : dataset.time_steps()) {
    if (time.number() == step) {
      return time.value();
    }
  }
  return std::nullopt;
}

// Returns the nearest of `steps`, which ascend with their times; of two the earlier. Compares two
// neighbours alone: distances from far away would round to one number.
int NearestStep(const v1::Dataset& dataset, const std::vector<int>& steps, double time) {
  const auto next = std::find_if(steps.begin(), steps.end(), [&](int step) {
    return TimeOf(dataset, step).value_or(0) >= time;
  });
  if (next == steps.begin()) {
    return *next;
  }
  const int before = *(next - 1);
  if (next == steps.end()) {
    return before;
  }
  const double to_next = TimeOf(dataset, *next).value_or(0) - time;
  return time - TimeOf(dataset, before).value_or(0) <= to_next ? before : *next;
}

absl::StatusOr<int> ChooseStep(const v1::Dataset& dataset, const v1::FieldSelection& selection,
                               const std::vector<int>& steps) {
  if (steps.empty()) {
    return base::WithReason(
        absl::FailedPreconditionError(absl::StrCat(
            "dataset \"", dataset.name(), "\": no step of the field is served by all shards yet")),
        base::ErrorReason::kDatasetIncomplete);
  }
  switch (selection.when_case()) {
    case v1::FieldSelection::kTimeStep: {
      const int step = selection.time_step();
      if (step == -1) {
        return steps.back();
      }
      if (!std::binary_search(steps.begin(), steps.end(), step)) {
        return absl::NotFoundError(absl::StrCat("selection.time_step is ", step, ": dataset \"",
                                                dataset.name(), "\" serves steps ",
                                                DescribeSteps(steps), " of the field"));
      }
      return step;
    }
    case v1::FieldSelection::kTime: {
      if (!std::isfinite(selection.time())) {
        return absl::InvalidArgumentError(
            absl::StrCat("selection.time is ", selection.time(), ": must be finite"));
      }
      if (!TimeOf(dataset, steps.front()).has_value()) {
        return absl::InvalidArgumentError(absl::StrCat("selection.time is ", selection.time(),
                                                       ": dataset \"", dataset.name(),
                                                       "\" has no times"));
      }
      return NearestStep(dataset, steps, selection.time());
    }
    case v1::FieldSelection::WHEN_NOT_SET:
      return steps.back();
  }
  return steps.back();
}

// Shards by the agents that have all of `ids`.
std::vector<ReplicaSet> ReplicaSetsOf(const SeriesState& series,
                                      const std::map<ScalarVolumeKey, std::string>& ids) {
  std::vector<ReplicaSet> sets;
  std::map<std::vector<std::string>, std::size_t> set_of;  // by addresses
  for (const auto& [shard, owners] : series.owners) {
    std::vector<const SeriesOwner*> with_all;
    for (const SeriesOwner& owner : owners) {
      const bool has_all = std::all_of(ids.begin(), ids.end(), [&](const auto& wanted) {
        const auto found = owner.volumes.find(wanted.first);
        return found != owner.volumes.end() && found->second == wanted.second;
      });
      if (has_all) {
        with_all.push_back(&owner);
      }
    }
    const bool all_drain = std::all_of(with_all.begin(), with_all.end(),
                                       [](const SeriesOwner* owner) { return owner->is_draining; });
    std::erase_if(with_all,
                  [&](const SeriesOwner* owner) { return owner->is_draining && !all_drain; });
    if (with_all.empty()) {
      continue;
    }
    std::vector<std::string> addresses;
    addresses.reserve(with_all.size());
    for (const SeriesOwner* owner : with_all) {
      addresses.push_back(owner->agent.address);
    }
    const auto [entry, is_new] = set_of.emplace(std::move(addresses), sets.size());
    if (is_new) {
      ReplicaSet& set = sets.emplace_back();
      for (const SeriesOwner* owner : with_all) {
        set.agents.push_back(owner->agent);
      }
    }
    sets[entry->second].shard_indices.push_back(shard);
  }
  return sets;
}

// Agents that have one volume of a shard each, but none that has both, can't draw a frame of both.
absl::Status CheckAllShards(const SeriesState& series, const v1::Dataset& dataset,
                            const DatasetState& volume) {
  std::set<int> served;
  for (const ReplicaSet& set : volume.replica_sets) {
    served.insert(set.shard_indices.begin(), set.shard_indices.end());
  }
  for (const auto& [shard, owners] : series.owners) {
    if (served.count(shard) == 0) {
      return absl::UnavailableError(
          absl::StrCat("dataset \"", dataset.name(),
                       "\": no agent has both the surfaces' field and that of the "
                       "colours for shard ",
                       shard, "; retry when agents have been updated"));
    }
  }
  return absl::OkStatus();
}

// The range of a colour map that the request leaves out. It holds more than one value.
void SetRange(const v1::FieldComponent& component, v1::ColorBy* color_by) {
  if (color_by->has_range()) {
    return;
  }
  const bool is_known = component.has_value_range() &&
                        std::isfinite(component.value_range().min()) &&
                        std::isfinite(component.value_range().max());
  const double min = is_known ? component.value_range().min() : 0;
  const double max = is_known ? component.value_range().max() : 1;
  color_by->mutable_range()->set_min(min);
  color_by->mutable_range()->set_max(max > min ? max : min + std::max(1.0, std::abs(min)));
}

absl::Status CheckNoFields(const v1::Dataset& dataset, const v1::FieldSelection* selection,
                           const google::protobuf::RepeatedPtrField<v1::Surface>& surfaces) {
  if (selection != nullptr) {
    return absl::InvalidArgumentError(absl::StrCat("selection is set: dataset \"", dataset.name(),
                                                   "\" has one field and one step; leave it out"));
  }
  for (int i = 0; i < surfaces.size(); ++i) {
    if (surfaces[i].color_by().quantity() == v1::ColorBy::QUANTITY_FIELD) {
      return absl::InvalidArgumentError(absl::StrCat(
          "surfaces[", i, "].color_by.field is ", Quoted(surfaces[i].color_by().field()),
          ": dataset \"", dataset.name(), "\" has one field"));
    }
  }
  return absl::OkStatus();
}

// A digest of the offered volumes of each step. O(volumes).
std::map<int, std::string> DigestsOfSteps(const SeriesState& series) {
  std::map<int, std::string> digests;  // first what is digested
  for (const auto& [key, id] : series.offered) {
    absl::StrAppend(&digests[key.step], key.field, " ", key.component, " ", id, "\n");
  }
  constexpr std::size_t kDigits = 32;
  for (auto& [step, digest] : digests) {
    digest = base::Sha256Hex(digest).substr(0, kDigits);
  }
  return digests;
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

absl::StatusOr<SelectedVolume> SelectVolume(
    const std::shared_ptr<const DatasetState>& dataset, const v1::FieldSelection* selection,
    google::protobuf::RepeatedPtrField<v1::Surface>* surfaces) {
  SelectedVolume selected;
  const v1::Dataset& description = dataset->dataset;
  if (dataset->series == nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(CheckNoFields(description, selection, *surfaces));
    selected.dataset = dataset;
    return selected;
  }
  const SeriesState& series = *dataset->series;
  const v1::FieldSelection asked = selection != nullptr ? *selection : v1::FieldSelection();
  ISOSCOPE_ASSIGN_OR_RETURN(const FieldPlace place,
                            FindField(description, asked.field(), asked.component(), "selection."));
  ISOSCOPE_ASSIGN_OR_RETURN(const int step, ChooseStep(description, asked, StepsOf(series, place)));
  const ScalarVolumeKey key{.field = place.field, .component = place.component, .step = step};
  std::map<ScalarVolumeKey, std::string> ids = {{key, series.offered.at(key)}};

  for (int i = 0; i < surfaces->size(); ++i) {
    v1::Surface& surface = *surfaces->Mutable(i);
    if (surface.color_by().quantity() != v1::ColorBy::QUANTITY_FIELD) {
      continue;
    }
    v1::ColorBy* const color_by = surface.mutable_color_by();
    const std::string path = absl::StrCat("surfaces[", i, "].color_by.");
    ISOSCOPE_ASSIGN_OR_RETURN(const FieldPlace color, FindField(description, color_by->field(),
                                                                color_by->component(), path));
    const ScalarVolumeKey color_key{
        .field = color.field, .component = color.component, .step = step};
    const auto offered = series.offered.find(color_key);
    if (offered == series.offered.end()) {
      return absl::NotFoundError(
          absl::StrCat(path, "field is ", Quoted(color_by->field()), ": served at steps ",
                       DescribeSteps(StepsOf(series, color)), ", the surfaces are of step ", step));
    }
    ids.insert(*offered);
    selected.color_dataset_ids.resize(static_cast<std::size_t>(surfaces->size()));
    selected.color_dataset_ids[static_cast<std::size_t>(i)] = offered->second;
    const v1::FieldComponent& component =
        description.fields(color.field).components(color.component);
    SetRange(component, color_by);
  }

  auto volume = std::make_shared<DatasetState>();
  volume->dataset = description;
  volume->dataset.set_dataset_id(ids.at(key));
  volume->dataset.clear_fields();
  volume->dataset.clear_time_steps();
  const v1::Field& field = description.fields(place.field);
  const v1::FieldComponent& component = field.components(place.component);
  volume->dataset.set_sample_type(component.sample_type());
  volume->dataset.clear_value_range();
  if (component.has_value_range()) {
    *volume->dataset.mutable_value_range() = component.value_range();
  }
  volume->dataset.clear_max_gradient_magnitude();
  if (component.has_max_gradient_magnitude()) {
    volume->dataset.set_max_gradient_magnitude(component.max_gradient_magnitude());
  }
  volume->status = dataset->status;
  volume->replica_sets = ReplicaSetsOf(series, ids);
  ISOSCOPE_RETURN_IF_ERROR(CheckAllShards(series, description, *volume));
  volume->picture_revision = dataset->picture_revision;
  volume->is_served = dataset->is_served;
  selected.dataset = std::move(volume);

  v1::FieldSelection& used = selected.selection.emplace();
  used.set_field(field.name());
  used.set_component(component.name());
  used.set_time_step(step);
  selected.time = TimeOf(description, step);
  return selected;
}

}  // namespace isoscope::server
