#include "core/partition/level_plan.h"

#include <algorithm>

#include "absl/strings/str_format.h"

#include "core/volume/block_layout.h"

namespace isoscope::partition {
namespace {

// The highest level that can be made for this cut.
int HighestPossible(const volume::GridGeometry& geometry, volume::ScalarType type,
                    volume::LevelFilter filter, const math::Index3& block_cells, int shard_count) {
  int level = 0;
  while (level < volume::HighestLevel(geometry.sample_dims)) {
    const volume::VolumeLevel next = volume::LevelOf(geometry, type, filter, level + 1);
    const auto layout = volume::BlockLayout::Make(next.grid.sample_dims, block_cells);
    if (!layout.ok() || layout->block_count() < shard_count || !volume::Validate(next.grid).ok()) {
      break;
    }
    ++level;
  }
  return level;
}

}  // namespace

volume::LevelFilter FilterFor(const LevelOptions& options, volume::ScalarType type,
                              bool has_labels) {
  const volume::LevelFilter wanted = options.filter.value_or(
      has_labels ? volume::LevelFilter::kMajority : volume::LevelFilter::kMean);
  return volume::CanFilter(wanted, type) ? wanted : volume::LevelFilter::kMean;
}

absl::StatusOr<LevelPlan> PlanLevels(const LevelOptions& options,
                                     const volume::GridGeometry& geometry, volume::ScalarType type,
                                     const math::Index3& block_cells, int shard_count,
                                     bool has_labels) {
  LevelPlan plan{.highest = 0, .filter = FilterFor(options, type, has_labels)};
  const int possible = HighestPossible(geometry, type, plan.filter, block_cells, shard_count);
  if (options.highest == LevelOptions::kAuto) {
    plan.highest = std::min(volume::AutoHighestLevel(geometry.sample_dims), possible);
    return plan;
  }
  if (options.highest < 0 || options.highest > possible) {
    const math::Index3& dims = geometry.sample_dims;
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d levels of %d x %d x %d samples in blocks of %d x %d x %d cells for %d shards: 0 to %d "
        "are possible, because a level has at least 2 samples on each axis and a block for each "
        "shard",
        options.highest, dims.x, dims.y, dims.z, block_cells.x, block_cells.y, block_cells.z,
        shard_count, possible));
  }
  plan.highest = options.highest;
  return plan;
}

std::int64_t BytesOfLevels(const LevelPlan& plan, const volume::GridGeometry& geometry,
                           volume::ScalarType type) {
  std::int64_t bytes = 0;
  for (int level = 1; level <= plan.highest; ++level) {
    const volume::VolumeLevel of = volume::LevelOf(geometry, type, plan.filter, level);
    bytes += math::Volume(of.grid.sample_dims) * static_cast<std::int64_t>(volume::SizeOf(of.type));
  }
  return bytes;
}

}  // namespace isoscope::partition
