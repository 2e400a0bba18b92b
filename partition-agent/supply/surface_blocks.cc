// Find, for each shard and each surface:
//
//   1. The list of active blocks may be in the cache, from an earlier frame.
//   2. For an isovalue, the interval tree is queried. The blocks come in any order (Sorted).
//   3. For labels, the range table says which blocks are active.
//
// Invariant: a list is ascending by block id, and its ordinals agree with the block index.

#include "partition-agent/supply/surface_blocks.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/frame/frame_spec.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"

namespace isoscope::agent {
namespace {

using ActiveList = std::shared_ptr<const std::vector<ActiveBlock>>;

bool HasLessId(const ActiveBlock& a, const ActiveBlock& b) { return a.block_id < b.block_id; }

// Returns the blocks of a query, ascending. The rank of an id among all is its index in the list: in
// a set that is small, this is cheaper than sorting.
ActiveList Sorted(const std::vector<index::BlockInterval>& found, std::int64_t block_count,
                  bool is_large) {
  auto active = std::make_shared<std::vector<ActiveBlock>>();
  if (is_large) {
    active->reserve(found.size());
    for (const index::BlockInterval& interval : found) {
      active->push_back({interval.block_id, interval.ordinal});
    }
    std::sort(active->begin(), active->end(), HasLessId);
    const auto has_same_id = [](const ActiveBlock& a, const ActiveBlock& b) {
      return a.block_id == b.block_id;
    };
    active->erase(std::unique(active->begin(), active->end(), has_same_id), active->end());
    return active;
  }
  volume::BlockSet ids(block_count);
  for (const index::BlockInterval& interval : found) {
    ids.Insert(interval.block_id);
  }
  const volume::BlockRanks ranks(ids);
  active->resize(ranks.count());
  for (const index::BlockInterval& interval : found) {
    (*active)[ranks.RankOf(interval.block_id)] = {interval.block_id, interval.ordinal};
  }
  return active;
}

absl::StatusOr<ActiveList> QueryTree(const Shard& shard, double isovalue, bool is_large,
                                     IndexCost* cost) {
  ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result, shard.tree->Query(isovalue));
  cost->page_read_count += result.page_read_count;
  cost->read_bytes += result.read_bytes;
  const store::ShardReader& reader = *shard.reader;
  for (const index::BlockInterval& interval : result.active) {
    if (interval.ordinal >= reader.block_count() ||
        reader.block_id(interval.ordinal) != interval.block_id) {
      return absl::DataLossError(absl::StrFormat(
          "%s: the interval tree names block %d at ordinal %d of %d, where the block index has "
          "another",
          reader.directory(), interval.block_id, interval.ordinal, reader.block_count()));
    }
  }
  return Sorted(result.active, reader.layout().block_count(), is_large);
}

// Returns the blocks of a shard that are in `volume_blocks`, in any order.
template <typename Blocks>
std::vector<ActiveBlock> MembersOf(const store::ShardReader& reader, const Blocks& volume_blocks) {
  std::vector<ActiveBlock> members;
  for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
    if (volume_blocks.Contains(reader.block_id(ordinal))) {
      members.push_back({reader.block_id(ordinal), ordinal});
    }
  }
  return members;
}

// A surface of labels meets the blocks of many stabs of the tree, and mostly the same ones. The
// range table has them all: in one pass, or by its octree if it is large.
absl::StatusOr<ActiveList> BlocksOfLabels(const Shard& shard, const volume::InsideRule& rule,
                                          bool is_large) {
  const store::ShardReader& reader = *shard.reader;
  auto active = std::make_shared<std::vector<ActiveBlock>>();
  if (is_large) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> volume_blocks,
                              reader.ActiveTree(rule));
    *active = MembersOf(reader, *volume_blocks);
  } else {
    *active = MembersOf(reader, *reader.ActiveBlocks(rule));
  }
  std::sort(active->begin(), active->end(), HasLessId);
  active->shrink_to_fit();
  return active;
}

ChosenMesh MeshAt(const std::vector<ActiveBlock>& active, std::size_t active_index,
                  std::size_t shard_index, std::size_t surface_index) {
  return {.block_id = active[active_index].block_id,
          .ordinal = active[active_index].ordinal,
          .active_index = static_cast<std::uint32_t>(active_index),
          .shard_index = static_cast<std::uint32_t>(shard_index),
          .surface_index = static_cast<std::uint32_t>(surface_index)};
}

}  // namespace

absl::StatusOr<SurfaceBlocks> SurfaceBlocks::Find(Shards shards,
                                                  std::vector<volume::InsideRule> rules,
                                                  BlockCache* cache,
                                                  const base::Cancellation& cancellation,
                                                  IndexCost* cost, std::int64_t max_dense_blocks) {
  ISOSCOPE_CHECK(!shards.empty() && !rules.empty());
  SurfaceBlocks blocks;
  blocks.shards_ = std::move(shards);
  blocks.rules_ = std::move(rules);
  blocks.is_large_ = blocks.shards_.front()->reader->layout().block_count() > max_dense_blocks;
  for (const std::shared_ptr<const Shard>& shard : blocks.shards_) {
    for (const volume::InsideRule& rule : blocks.rules_) {
      ActiveList active = cache == nullptr ? nullptr : cache->FindActive(*shard, rule);
      ++(active != nullptr ? cost->kept_list_count : cost->queried_list_count);
      if (active == nullptr) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        if (rule.has_labels()) {
          ISOSCOPE_ASSIGN_OR_RETURN(active, BlocksOfLabels(*shard, rule, blocks.is_large_));
        } else {
          ISOSCOPE_ASSIGN_OR_RETURN(active,
                                    QueryTree(*shard, rule.isovalue, blocks.is_large_, cost));
        }
        if (cache != nullptr) {
          cache->InsertActive(*shard, rule, active);
        }
      }
      blocks.active_.push_back(std::move(active));
    }
  }
  return blocks;
}

void SurfaceBlocks::EraseOutside(const view::Clipper& clipper) {
  if (clipper.empty()) {
    return;
  }
  const volume::BlockLayout& layout = shards_.front()->reader->layout();
  is_shown_.clear();
  for (const ActiveList& active : active_) {
    std::vector<bool>& is_shown = is_shown_.emplace_back(active->size());
    for (std::size_t i = 0; i < active->size(); ++i) {
      is_shown[i] = clipper.SideOf(layout, (*active)[i].block_id) != view::Clipper::Side::kOutside;
    }
  }
}

std::int64_t SurfaceBlocks::block_count() const {
  if (rules_.size() > 1) {
    return static_cast<std::int64_t>(Ids().size());
  }
  std::int64_t count = 0;
  for (std::size_t list = 0; list < active_.size(); ++list) {
    count += is_shown_.empty() ? static_cast<std::int64_t>(active_[list]->size())
                               : std::count(is_shown_[list].begin(), is_shown_[list].end(), true);
  }
  return count;
}

std::vector<volume::BlockId> SurfaceBlocks::Ids() const {
  std::vector<volume::BlockId> ids;
  for (std::size_t list = 0; list < active_.size(); ++list) {
    const std::vector<ActiveBlock>& active = *active_[list];
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (IsShown(list, i)) {
        ids.push_back(active[i].block_id);
      }
    }
  }
  if (active_.size() == 1) {
    return ids;
  }
  if (!is_large_) {
    return volume::BlockSet(shards_.front()->reader->layout().block_count(), ids).Ids();
  }
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

std::vector<ChosenMesh> SurfaceBlocks::ChooseAll() const {
  std::vector<ChosenMesh> chosen;
  for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
    for (std::size_t surface = 0; surface < rules_.size(); ++surface) {
      const std::vector<ActiveBlock>& active = ActiveOf(shard, surface);
      chosen.reserve(chosen.size() + active.size());
      for (std::size_t i = 0; i < active.size(); ++i) {
        if (IsShown(shard * rules_.size() + surface, i)) {
          chosen.push_back(MeshAt(active, i, shard, surface));
        }
      }
    }
  }
  return chosen;
}

absl::StatusOr<std::vector<ChosenMesh>> SurfaceBlocks::Choose(
    const std::vector<volume::BlockId>& ids) const {
  std::vector<ChosenMesh> chosen;
  chosen.reserve(ids.size());
  std::vector<char> is_found(ids.size(), 0);
  for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
    for (std::size_t surface = 0; surface < rules_.size(); ++surface) {
      const std::vector<ActiveBlock>& active = ActiveOf(shard, surface);
      std::size_t id_index = 0;
      for (std::size_t i = 0; i < active.size() && id_index < ids.size(); ++i) {
        while (id_index < ids.size() && ids[id_index] < active[i].block_id) {
          ++id_index;
        }
        if (id_index < ids.size() && ids[id_index] == active[i].block_id &&
            IsShown(shard * rules_.size() + surface, i)) {
          is_found[id_index] = 1;
          chosen.push_back(MeshAt(active, i, shard, surface));
        }
      }
    }
  }
  const auto missing = std::count(is_found.begin(), is_found.end(), 0);
  if (missing != 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d of %d blocks to draw are not active blocks of this agent at %s",
                        missing, ids.size(), frame::TextOf(rules_)));
  }
  return chosen;
}

}  // namespace isoscope::agent
