// Computes the gradient of the field at points, and finds the shards of the blocks that show them:
// for picks.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_POINT_GRADIENTS_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_POINT_GRADIENTS_H_

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// The gradient at one of the points asked for.
struct PointGradient {
  std::size_t point_index = 0;
  math::Vec3d gradient;  // field units for each world unit, world space; finite

  friend bool operator==(const PointGradient&, const PointGradient&) = default;
};

// Returns the gradients (volume::GradientAt) at those points whose cells these shards hold and
// where the gradient is finite, in the order of the points. Exactly one shard of a dataset holds
// the cell of a point. Reads each block once. O(blocks of the shards + points). Blocks.
//
// shards: of one dataset, at least one
// points: in world space, finite
//
// DATA_LOSS as ShardReader::ReadDiskRun; CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<std::vector<PointGradient>> GradientsAt(const Shards& shards,
                                                       const std::vector<math::Vec3d>& points,
                                                       const base::Cancellation& cancellation);

// The shard of the block that shows one of the points asked for.
struct PointShard {
  std::size_t point_index = 0;
  int shard_index = 0;

  friend bool operator==(const PointShard&, const PointShard&) = default;
};

// Returns the shards of those blocks that these shards hold, in the order of the points. The block
// that shows a point need not hold the point's cell: on a face it may be the neighbour. O(blocks of
// the shards + points).
//
// shards:    of one dataset
// block_ids: of each point; not set: no block
std::vector<PointShard> ShardsOf(const Shards& shards,
                                 const std::vector<std::optional<volume::BlockId>>& block_ids);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_POINT_GRADIENTS_H_
