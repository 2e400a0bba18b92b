#include "server/cluster/served_levels.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/volume/block_layout.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using volume::LevelFilter;

// The owners of each shard that have the level. Empty unless every shard has one.
std::map<int, std::vector<ShardOwner>> OwnersOfLevel(
    const std::map<int, std::vector<LevelOwner>>& owners, int level, LevelFilter filter) {
  std::map<int, std::vector<ShardOwner>> with_level;
  for (const auto& [shard, of_shard] : owners) {
    for (const LevelOwner& owner : of_shard) {
      const std::vector<int>& levels = owner.owned.levels;
      if (owner.owned.filter == filter &&
          std::find(levels.begin(), levels.end(), level) != levels.end()) {
        with_level[shard].push_back(owner);
      }
    }
  }
  return with_level.size() == owners.size() ? with_level : std::map<int, std::vector<ShardOwner>>();
}

// "level 0 alone; ..." or "levels 0, 1, 2".
std::string TextOfServed(const std::vector<ServedLevel>& levels) {
  if (levels.empty()) {
    return "level 0 alone; `isoscope partition --add-levels` makes others";
  }
  return absl::StrCat("levels 0, ",
                      absl::StrJoin(levels, ", ", [](std::string* out, const ServedLevel& level) {
                        absl::StrAppend(out, level.level);
                      }));
}

// Returns the index of the first surface that does not fit; not set if all do.
std::optional<std::size_t> FirstMisfit(const std::vector<volume::InsideRule>& rules,
                                       LevelFilter filter) {
  const auto misfit = std::find_if(rules.begin(), rules.end(), [&](const volume::InsideRule& rule) {
    return !FitsLevels(rule, filter);
  });
  return misfit == rules.end() ? std::nullopt
                               : std::optional(static_cast<std::size_t>(misfit - rules.begin()));
}

absl::StatusOr<const ServedLevel*> FindNamed(const std::vector<ServedLevel>& levels,
                                             const v1::Dataset& dataset,
                                             const std::vector<volume::InsideRule>& rules,
                                             int named) {
  const auto found = std::find_if(levels.begin(), levels.end(),
                                  [&](const ServedLevel& served) { return served.level == named; });
  if (found == levels.end()) {
    return absl::FailedPreconditionError(
        absl::StrCat("level is ", named, ": dataset \"", dataset.name(), "\" is served with ",
                     TextOfServed(levels),
                     // Levels are made without gaps.
                     !levels.empty() && named < levels.back().level
                         ? "; a shard lacks it, or its files are damaged: `isoscope verify` tells"
                         : "",
                     "; leave the level out, or give max_spacing_px"));
  }
  if (const std::optional<std::size_t> misfit = FirstMisfit(rules, found->filter);
      misfit.has_value()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "level is ", named, ": surfaces[", *misfit, "], ", rules[*misfit].Text(),
        found->filter == LevelFilter::kMean
            ? ", has labels, and the levels are means, which have none: ask for level 0, or make "
              "levels with `isoscope partition --label-levels`"
            : ", has an isovalue, and the levels are majorities of labels: ask for level 0"));
  }
  return &*found;
}

}  // namespace

std::vector<ReplicaSet> GroupByAgents(const std::map<int, std::vector<ShardOwner>>& owners) {
  std::vector<ReplicaSet> sets;
  std::map<std::vector<std::string>, std::size_t> set_of;  // by addresses
  for (const auto& [shard, of_shard] : owners) {
    const bool all_drain = std::all_of(of_shard.begin(), of_shard.end(),
                                       [](const ShardOwner& owner) { return owner.is_draining; });
    std::vector<ServingAgent> agents;
    std::vector<std::string> addresses;
    for (const ShardOwner& owner : of_shard) {
      if (all_drain || !owner.is_draining) {
        agents.push_back(owner.agent);
        addresses.push_back(owner.agent.address);
      }
    }
    if (agents.empty()) {
      continue;
    }
    const auto [entry, is_new] = set_of.emplace(std::move(addresses), sets.size());
    if (is_new) {
      sets.emplace_back().agents = std::move(agents);
    }
    sets[entry->second].shard_indices.push_back(shard);
  }
  return sets;
}

std::vector<ServedLevel> ServedLevelsOf(const std::map<int, std::vector<LevelOwner>>& owners) {
  std::set<int> known;
  for (const auto& [shard, of_shard] : owners) {
    for (const LevelOwner& owner : of_shard) {
      known.insert(owner.owned.levels.begin(), owner.owned.levels.end());
    }
  }
  // One filter for all levels: a choice among them has one look.
  for (const LevelFilter filter : {LevelFilter::kMean, LevelFilter::kMajority}) {
    std::vector<ServedLevel> served;
    for (const int level : known) {
      std::vector<ReplicaSet> sets = GroupByAgents(OwnersOfLevel(owners, level, filter));
      if (!sets.empty()) {
        served.push_back({.level = level, .filter = filter, .replica_sets = std::move(sets)});
      }
    }
    if (!served.empty()) {
      return served;
    }
  }
  return {};
}

void AddLevels(const std::vector<ServedLevel>& levels, v1::Dataset* dataset) {
  if (levels.empty()) {
    return;
  }
  const absl::StatusOr<volume::GridGeometry> grid =
      wire::GeometryFromProto(dataset->geometry(), "geometry");
  ISOSCOPE_CHECK(grid.ok());
  const v1::Dimensions& cells = dataset->block_cells();
  for (const ServedLevel& served : levels) {
    // The grid does not depend on the sample type.
    const volume::VolumeLevel level =
        volume::LevelOf(*grid, volume::ScalarType::kUint8, served.filter, served.level);
    const absl::StatusOr<volume::BlockLayout> layout =
        volume::BlockLayout::Make(level.grid.sample_dims, {cells.x(), cells.y(), cells.z()});
    ISOSCOPE_CHECK(layout.ok());
    v1::DatasetLevel* const out = dataset->add_levels();
    out->set_level(served.level);
    *out->mutable_geometry() = wire::ToProto(level.grid);
    out->set_block_count(layout->block_count());
    out->set_filter(served.filter == LevelFilter::kMean ? v1::DatasetLevel::FILTER_MEAN
                                                        : v1::DatasetLevel::FILTER_MAJORITY);
  }
}

bool FitsLevels(const volume::InsideRule& rule, LevelFilter filter) {
  return rule.has_labels() == (filter == LevelFilter::kMajority);
}

absl::StatusOr<const ServedLevel*> ChooseLevel(const std::vector<ServedLevel>& levels,
                                               const v1::Dataset& dataset,
                                               const volume::GridGeometry& grid,
                                               const std::vector<volume::InsideRule>& rules,
                                               const view::LevelChoice& choice,
                                               double pixels_per_unit) {
  if (choice.level.has_value()) {
    if (*choice.level == 0) {
      return static_cast<const ServedLevel*>(nullptr);
    }
    return FindNamed(levels, dataset, rules, *choice.level);
  }
  if (levels.empty() || FirstMisfit(rules, levels.front().filter).has_value()) {
    return static_cast<const ServedLevel*>(nullptr);
  }
  const int coarsest =
      view::CoarsestLevel(grid, pixels_per_unit, choice.max_spacing_px, levels.back().level);
  const ServedLevel* chosen = nullptr;
  for (const ServedLevel& served : levels) {
    chosen = served.level <= coarsest ? &served : chosen;
  }
  return chosen;
}

int CoarsestOf(const std::vector<ServedLevel>& levels,
               const std::vector<volume::InsideRule>& rules) {
  return levels.empty() || FirstMisfit(rules, levels.front().filter).has_value()
             ? 0
             : levels.back().level;
}

const ServedLevel* CoarserOf(const std::vector<ServedLevel>& levels,
                             const std::vector<volume::InsideRule>& rules,
                             const ServedLevel* chosen, int least) {
  const int chosen_level = chosen == nullptr ? 0 : chosen->level;
  if (least <= chosen_level || CoarsestOf(levels, rules) <= chosen_level) {
    return chosen;
  }
  const auto first = std::find_if(levels.begin(), levels.end(),
                                  [&](const ServedLevel& served) { return served.level >= least; });
  return first == levels.end() ? &levels.back() : &*first;
}

}  // namespace isoscope::server
