// Find, for each shard and each surface:
//
//   1. The list of active blocks may be in the cache, from an earlier frame.
//   2. For an isovalue, the interval tree is queried. The blocks come in any order; the rank of an
//      id in the set of all is its index in the list, which is cheaper than sorting.
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

namespace isoscope::agent {
namespace {

using ActiveList = std::shared_ptr<const std::vector<ActiveBlock>>;

absl::StatusOr<ActiveList> QueryTree(const Shard& shard, double isovalue, IndexCost* cost) {
  ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result, shard.tree->Query(isovalue));
  cost->page_read_count += result.page_read_count;
  cost->read_bytes += result.read_bytes;
  const store::ShardReader& reader = *shard.reader;
  volume::BlockSet ids(reader.layout().block_count());
  for (const index::BlockInterval& interval : result.active) {
    if (interval.ordinal >= reader.block_count() ||
        reader.block_id(interval.ordinal) != interval.block_id) {
      return absl::DataLossError(absl::StrFormat(
          "%s: the interval tree names block %d at ordinal %d of %d, where the block index has "
          "another",
          reader.directory(), interval.block_id, interval.ordinal, reader.block_count()));
    }
    ids.Insert(interval.block_id);
  }
  // The rank of a block's id is its index in the result. This is cheaper than sorting.
  const volume::BlockRanks ranks(ids);
  auto active = std::make_shared<std::vector<ActiveBlock>>(ranks.count());
  for (const index::BlockInterval& interval : result.active) {
    (*active)[ranks.RankOf(interval.block_id)] = {interval.block_id, interval.ordinal};
  }
  return active;
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
absl::StatusOr<ActiveList> BlocksOfLabels(const Shard& shard, const volume::InsideRule& rule) {
  const store::ShardReader& reader = *shard.reader;
  auto active = std::make_shared<std::vector<ActiveBlock>>();
  if (reader.layout().block_count() > volume::kMaxDenseBlocks) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> volume_blocks,
                              reader.ActiveTree(rule));
    *active = MembersOf(reader, *volume_blocks);
  } else {
    *active = MembersOf(reader, *reader.ActiveBlocks(rule));
  }
  std::sort(active->begin(), active->end(),
            [](const ActiveBlock& a, const ActiveBlock& b) { return a.block_id < b.block_id; });
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
                                                  IndexCost* cost) {
  ISOSCOPE_CHECK(!shards.empty() && !rules.empty());
  SurfaceBlocks blocks;
  blocks.shards_ = std::move(shards);
  blocks.rules_ = std::move(rules);
  for (const std::shared_ptr<const Shard>& shard : blocks.shards_) {
    for (const volume::InsideRule& rule : blocks.rules_) {
      ActiveList active = cache == nullptr ? nullptr : cache->FindActive(*shard, rule);
      ++(active != nullptr ? cost->kept_list_count : cost->queried_list_count);
      if (active == nullptr) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        if (rule.has_labels()) {
          ISOSCOPE_ASSIGN_OR_RETURN(active, BlocksOfLabels(*shard, rule));
        } else {
          ISOSCOPE_ASSIGN_OR_RETURN(active, QueryTree(*shard, rule.isovalue, cost));
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
  volume::BlockSet shown(layout.block_count());
  for (const volume::BlockId id : Ids()) {
    shown.Insert(id);
  }
  clipper.EraseOutside(layout, &shown);
  shown_ = std::move(shown);
}

std::int64_t SurfaceBlocks::block_count() const {
  if (shown_) {
    return shown_->Count();
  }
  if (rules_.size() > 1) {
    return static_cast<std::int64_t>(Ids().size());
  }
  std::int64_t count = 0;
  for (const ActiveList& active : active_) {
    count += static_cast<std::int64_t>(active->size());
  }
  return count;
}

std::vector<volume::BlockId> SurfaceBlocks::Ids() const {
  if (shown_) {
    return shown_->Ids();
  }
  volume::BlockSet ids(shards_.front()->reader->layout().block_count());
  for (const ActiveList& active : active_) {
    for (const ActiveBlock& block : *active) {
      ids.Insert(block.block_id);
    }
  }
  return ids.Ids();
}

std::vector<ChosenMesh> SurfaceBlocks::ChooseAll() const {
  std::vector<ChosenMesh> chosen;
  for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
    for (std::size_t surface = 0; surface < rules_.size(); ++surface) {
      const std::vector<ActiveBlock>& active = ActiveOf(shard, surface);
      chosen.reserve(chosen.size() + active.size());
      for (std::size_t i = 0; i < active.size(); ++i) {
        if (IsShown(active[i].block_id)) {
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
            IsShown(active[i].block_id)) {
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
