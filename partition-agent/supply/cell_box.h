// The box of the active cells of an agent's shards, for cameras that fit the surface.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_CELL_BOX_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_CELL_BOX_H_

#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/math/box.h"
#include "core/view/clip_region.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// Returns the least box, in index space, around the cells of the shards that are active for any
// rule and not wholly outside of the region; empty if there are none. The boxes of all shards
// together are that of the volume, however it is cut.
//
// Reads blocks from the outside in, and leaves out those that lie in the box by then: mostly a few
// are read. Without a cell that counts, as of labels that no sample has, all active blocks are: as
// many as a frame reads that shows them all. Reads on several threads, as BlockReads.
//
// shards: of one dataset, at least one
// rules:  at least one; isovalues are finite
//
// Errors: as SurfaceBlocks::Find and BlockReads::ForEach; CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<math::IndexBox> CellBoxOfShards(const Shards& shards,
                                               const std::vector<volume::InsideRule>& rules,
                                               const view::ClipRegion& clip,
                                               const AgentResources& resources,
                                               const base::Cancellation& cancellation);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_CELL_BOX_H_
