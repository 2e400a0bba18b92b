#include "partition-agent/supply/level_resolution.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/base/status_macros.h"
#include "core/extract/active_cells.h"
#include "core/volume/block_samples.h"
#include "core/volume/block_set.h"
#include "core/volume/resolved_blocks.h"
#include "partition-agent/supply/block_reads.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

absl::StatusOr<std::vector<volume::BlockId>> BlocksResolvedBy(
    const Shards& shards, const volume::InsideRule& rule, const LevelPair& pair,
    const AgentResources& resources, const base::Cancellation& cancellation) {
  // 1. The level's blocks that may resolve one.
  const volume::BlockLayout& layout = shards.front()->reader->layout();
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const SurfaceBlocks blocks,
      SurfaceBlocks::Find(shards, {rule}, resources.cache, cancellation, &cost));
  const volume::BlockSet chosen =
      volume::BlocksThatMayResolve(layout, volume::BlockSet(layout.block_count(), blocks.Ids()),
                                   pair.level, *pair.fine, *pair.fine_active);
  std::vector<BlockToRead> to_read;
  for (const ChosenMesh& mesh : blocks.ChooseAll()) {
    if (chosen.Contains(mesh.block_id)) {
      to_read.push_back({mesh.shard_index, mesh.ordinal});
    }
  }
  std::sort(to_read.begin(), to_read.end());

  // 2. Their cells with triangles.
  volume::ResolvedBlocks resolved(*pair.fine, pair.fine_active, pair.level);
  ISOSCOPE_RETURN_IF_ERROR(
      BlockReads(shards, to_read)
          .ForEach(resources, cancellation,
                   [&](std::size_t /*block*/, const volume::BlockSamples& samples) {
                     extract::ForEachActiveCell(
                         layout, samples, rule,
                         [&](const math::Index3& cell) { resolved.AddCell(cell); });
                     return cancellation.Check();
                   }));
  return resolved.Ids();
}

}  // namespace isoscope::agent
