// The values of scalar volumes where a surface of another one is seen, and the labels of surfaces
// that have labels: for picks.
//
// A value is the one that a colour by the volume shows (docs/numerics.md, "Values of another
// field"): of the values at the vertices of the triangle that is nearest to the point, mixed by the
// weights of the nearest point; on a cap, of the samples of the cell.
//
// A label is the sample at the inside end of the crossed edge of the point's cell whose middle is
// nearest (extract::LabelInCell). On a cap it is the nearest inside sample, and so it is where
// rounding has moved the point into a cell without the surface.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_POINT_VALUES_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_POINT_VALUES_H_

#include <cstddef>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// A point of a surface, and the block that shows it.
struct SurfacePoint {
  math::Vec3d position = {};                               // world space, finite
  std::optional<volume::BlockId> block_id = std::nullopt;  // not set: none
  volume::InsideRule rule = {};                            // of the surface
  bool is_on_cap = false;
};

// The values at one of the points asked for.
struct PointValues {
  std::size_t point_index = 0;
  std::vector<double> values;                  // by volume; NaN: none
  std::optional<double> label = std::nullopt;  // of a surface with labels

  friend bool operator==(const PointValues&, const PointValues&) = default;
};

// Returns the values at those points whose blocks these shards hold, in the order of the points.
// Reads each block once in each volume, and extracts it once for each surface and volume. Blocks.
//
// shards:  of the volume whose surfaces are seen, at least one
// volumes: for each, the shards of the same indices in the same order; may be none
//
// FAILED_PRECONDITION if a volume is cut in another way; DATA_LOSS as ShardReader::ReadDiskRun;
// CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<std::vector<PointValues>> ValuesAt(const Shards& shards,
                                                  const std::vector<Shards>& volumes,
                                                  const std::vector<SurfacePoint>& points,
                                                  const base::Cancellation& cancellation);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_POINT_VALUES_H_
