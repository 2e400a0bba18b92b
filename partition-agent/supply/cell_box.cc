// The search runs in rounds, until each active block lies in the box of the cells that were found:
//
//   1. Forget the blocks that lie in the box: their cells can't make it larger.
//   2. Find the hull of the other blocks. Choose blocks that touch one of its sides where it is
//      larger than the box.
//   3. Read them on several threads, and add their active cells to the box.
//
// A block that is not clipped has an active cell, unless samples are NaN. So one layer of blocks at
// each side mostly settles that side, and the first block with a cell at the very side does. Rounds
// grow, so that a surface which fills the volume costs a few blocks, and a thin one few rounds.
//
// Of a far source a round trip costs more than blocks do, and a unit has many blocks. So its rounds
// count units, and grow faster, and blocks of units that were read cost nothing. A layer of few units
// is the tip of a surface, which rarely reaches the very side: it is read at once.
//
// The result does not depend on the order: it is the box around all active cells.

#include "partition-agent/supply/cell_box.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <utility>

#include "core/base/status_macros.h"
#include "core/extract/active_cells.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_samples.h"
#include "partition-agent/supply/block_reads.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {
namespace {

// Reads of a round for each side of the box: blocks, or units of a far source.
constexpr std::size_t kFirstRoundReads = 4;
constexpr std::size_t kMaxRoundReads = 1024;
constexpr std::size_t kGrowth = 2;  // from round to round
constexpr std::size_t kFarGrowth = 4;
constexpr std::size_t kFewFarUnits = 16;  // of a layer

constexpr std::size_t kSides = 6;

using UnitKey = std::array<std::int64_t, 3>;

// An active block that was not read yet.
struct Candidate {
  BlockToRead block;
  volume::BlockId block_id = 0;
};

// Each active block once, ascending by shard and ordinal.
std::vector<Candidate> CandidatesOf(const SurfaceBlocks& blocks) {
  std::vector<Candidate> candidates;
  for (const ChosenMesh& mesh : blocks.ChooseAll()) {
    candidates.push_back({{mesh.shard_index, mesh.ordinal}, mesh.block_id});
  }
  const auto is_before = [](const Candidate& a, const Candidate& b) { return a.block < b.block; };
  const auto is_same = [](const Candidate& a, const Candidate& b) { return a.block == b.block; };
  std::sort(candidates.begin(), candidates.end(), is_before);
  candidates.erase(std::unique(candidates.begin(), candidates.end(), is_same), candidates.end());
  candidates.shrink_to_fit();
  return candidates;
}

// Finds the box, round by round. For a single use.
class CellBoxSearch {
 public:
  // All of them outlive the search.
  CellBoxSearch(const SurfaceBlocks& blocks, const view::Clipper& clipper,
                const AgentResources& resources, const base::Cancellation& cancellation)
      : blocks_(blocks),
        layout_(blocks.shards().front()->reader->layout()),
        clipper_(clipper),
        resources_(resources),
        cancellation_(cancellation),
        candidates_(CandidatesOf(blocks)) {}

  absl::StatusOr<math::IndexBox> Run() {
    for (std::size_t count = kFirstRoundReads;;) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      std::erase_if(candidates_, [&](const Candidate& candidate) {
        return box_.Covers(layout_.CellsOf(candidate.block_id));
      });
      if (candidates_.empty()) {
        return box_;
      }
      ISOSCOPE_RETURN_IF_ERROR(Read(TakeOutermost(count)));
      count = std::min(count * (read_units_.empty() ? kGrowth : kFarGrowth), kMaxRoundReads);
    }
  }

 private:
  // Removes and returns candidates that touch the hull of all where it exceeds the box: of at most
  // `count` reads for each side, and at least one. Their order stays.
  std::vector<BlockToRead> TakeOutermost(std::size_t count) {
    math::IndexBox hull;
    for (const Candidate& candidate : candidates_) {
      hull.Add(layout_.CellsOf(candidate.block_id));
    }
    std::array<std::size_t, kSides> left{};
    std::array<bool, kSides> exceeds{};
    for (std::size_t side = 0; side < kSides; ++side) {
      exceeds[side] = Exceeds(hull, side);
      left[side] =
          exceeds[side] && HasFewFarUnits(hull, side) ? std::max(count, kFewFarUnits) : count;
    }
    std::vector<BlockToRead> taken;
    std::erase_if(candidates_, [&](const Candidate& candidate) {
      const math::IndexBox cells = layout_.CellsOf(candidate.block_id);
      for (std::size_t side = 0; side < kSides; ++side) {
        if (!exceeds[side] || SideOf(cells, side) != SideOf(hull, side)) {
          continue;
        }
        const bool is_free = IsOfReadUnit(candidate);
        if (!is_free && left[side] == 0) {
          continue;
        }
        left[side] -= is_free ? 0 : 1;
        NoteUnit(candidate);
        taken.push_back(candidate.block);
        return true;
      }
      return false;
    });
    return taken;
  }

  // Returns the unit of a far source that has a block; nothing of other sources.
  [[nodiscard]] std::optional<UnitKey> FarUnitOf(const Candidate& candidate) const {
    const store::SampleReader* const samples =
        blocks_.shards()[candidate.block.shard_index]->reader->samples();
    if (samples == nullptr || samples->is_local()) {
      return std::nullopt;
    }
    const math::Index3 unit = samples->UnitOf(candidate.block_id);
    return UnitKey{unit.x, unit.y, unit.z};
  }
  // Whether the candidates at a side of the hull are of a far source, and of few of its units.
  [[nodiscard]] bool HasFewFarUnits(const math::IndexBox& hull, std::size_t side) const {
    std::set<UnitKey> units;
    for (const Candidate& candidate : candidates_) {
      if (SideOf(layout_.CellsOf(candidate.block_id), side) != SideOf(hull, side)) {
        continue;
      }
      const std::optional<UnitKey> unit = FarUnitOf(candidate);
      if (!unit.has_value()) {
        return false;
      }
      units.insert(*unit);
      if (units.size() > kFewFarUnits) {
        return false;
      }
    }
    return true;
  }
  [[nodiscard]] bool IsOfReadUnit(const Candidate& candidate) const {
    const std::optional<UnitKey> unit = FarUnitOf(candidate);
    return unit.has_value() && read_units_.contains(*unit);
  }
  void NoteUnit(const Candidate& candidate) {
    if (const std::optional<UnitKey> unit = FarUnitOf(candidate); unit.has_value()) {
      read_units_.insert(*unit);
    }
  }

  // The sides are those of begin, then those of end.
  static std::int64_t SideOf(const math::IndexBox& box, std::size_t side) {
    const int axis = static_cast<int>(side % 3);
    return side < 3 ? box.begin[axis] : box.end[axis];
  }
  [[nodiscard]] bool Exceeds(const math::IndexBox& hull, std::size_t side) const {
    return box_.empty() || (side < 3 ? SideOf(hull, side) < SideOf(box_, side)
                                     : SideOf(hull, side) > SideOf(box_, side));
  }

  absl::Status Read(const std::vector<BlockToRead>& blocks) {
    std::vector<math::IndexBox> found(blocks.size());
    ISOSCOPE_RETURN_IF_ERROR(
        BlockReads(blocks_.shards(), blocks)
            .ForEach(resources_, cancellation_,
                     [&](std::size_t block, const volume::BlockSamples& samples) {
                       found[block] = BoxOf(samples);
                       return cancellation_.Check();
                     }));
    for (const math::IndexBox& cells : found) {
      box_.Add(cells);
    }
    return absl::OkStatus();
  }

  [[nodiscard]] math::IndexBox BoxOf(const volume::BlockSamples& samples) const {
    const bool is_cut = clipper_.SideOf(layout_, samples.block_id) == view::Clipper::Side::kCut;
    return extract::BoxOfActiveCells(
        layout_, samples, blocks_.rules(), [&](const math::Index3& cell) {
          return !is_cut || clipper_.SideOf(math::IndexBox{cell, cell + math::Index3{1, 1, 1}}) !=
                                view::Clipper::Side::kOutside;
        });
  }

  const SurfaceBlocks& blocks_;
  const volume::BlockLayout& layout_;
  const view::Clipper& clipper_;
  const AgentResources& resources_;
  const base::Cancellation& cancellation_;
  std::vector<Candidate> candidates_;
  std::set<UnitKey> read_units_;  // of a far source, which all shards share
  math::IndexBox box_;
};

}  // namespace

absl::StatusOr<math::IndexBox> CellBoxOfShards(const Shards& shards,
                                               const std::vector<volume::InsideRule>& rules,
                                               const view::ClipRegion& clip,
                                               const AgentResources& resources,
                                               const base::Cancellation& cancellation) {
  const view::Clipper clipper(clip, shards.front()->reader->manifest().geometry);
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      SurfaceBlocks blocks,
      SurfaceBlocks::Find(shards, rules, resources.cache, cancellation, &cost));
  blocks.EraseOutside(clipper);
  return CellBoxSearch(blocks, clipper, resources, cancellation).Run();
}

}  // namespace isoscope::agent
