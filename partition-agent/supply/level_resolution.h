// The blocks of level 0 that a level shows something of, as far as an agent's shards tell
// (core/volume/resolved_blocks.h).

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_LEVEL_RESOLUTION_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_LEVEL_RESOLUTION_H_

#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// Level 0 of the volume, and one of its levels.
struct LevelPair {
  const volume::BlockLayout* fine = nullptr;       // of level 0
  const volume::BlockTree* fine_active = nullptr;  // its active blocks
  int level = 1;                                   // of the shards
};

// Returns the active blocks of level 0, ascending, that cells with triangles overlap, of the level's
// blocks in some shards. The union over all shards is that of the volume. Reads the blocks of the level that
// are active there and over active blocks of level 0, on several threads, as BlockReads.
//
// shards: of the level, at least one
// rule:   in stored values of the level
//
// Errors: as SurfaceBlocks::Find and BlockReads::ForEach; CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<std::vector<volume::BlockId>> BlocksResolvedBy(
    const Shards& shards, const volume::InsideRule& rule, const LevelPair& pair,
    const AgentResources& resources, const base::Cancellation& cancellation);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_LEVEL_RESOLUTION_H_
