// Which levels a dataset gets (volume/volume_level.h).

#ifndef ISOSCOPE_CORE_PARTITION_LEVEL_PLAN_H_
#define ISOSCOPE_CORE_PARTITION_LEVEL_PLAN_H_

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"
#include "core/volume/volume_level.h"

namespace isoscope::partition {

// What is asked for.
struct LevelOptions {
  static constexpr int kAuto = -1;  // volume::AutoHighestLevel, as far as levels have enough blocks
  int highest = 0;                  // levels 1 to this one; 0: none
  // Not set: the majority for integers with labels, else the mean.
  std::optional<volume::LevelFilter> filter = std::nullopt;
};

// What a volume gets.
struct LevelPlan {
  int highest = 0;
  volume::LevelFilter filter = volume::LevelFilter::kMean;
};

// The filter for a volume. Floats have no majorities: they get the mean, whatever is asked for.
volume::LevelFilter FilterFor(const LevelOptions& options, volume::ScalarType type,
                              bool has_labels);

// A level needs 2 samples on each axis, and a block for each shard. INVALID_ARGUMENT: more levels
// are asked for; the message says how many are possible.
absl::StatusOr<LevelPlan> PlanLevels(const LevelOptions& options,
                                     const volume::GridGeometry& geometry, volume::ScalarType type,
                                     const math::Index3& block_cells, int shard_count,
                                     bool has_labels);

// Returns the bytes of the samples of levels 1 to plan.highest.
std::int64_t BytesOfLevels(const LevelPlan& plan, const volume::GridGeometry& geometry,
                           volume::ScalarType type);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_LEVEL_PLAN_H_
