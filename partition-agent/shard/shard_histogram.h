// Statistics of an agent's shards by isovalue: sample counts by value, and the cost of surfaces
// from the ranges of blocks.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_HISTOGRAM_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_HISTOGRAM_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/view/clip_region.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// Returns the part of these shards. O(their blocks + bins); reads the histogram of each.
//
// shards: of one dataset, at least one
// range:  the range of values; finite, min <= max. Not set: all finite samples
//
// INVALID_ARGUMENT: no sample lies in the range. DATA_LOSS: a histogram is damaged.
absl::StatusOr<volume::HistogramPart> HistogramOfShards(
    const Shards& shards, std::int64_t max_bin_count,
    const std::optional<volume::ScalarSpan>& range);

// The blocks of the volume that are active for any of some surfaces, and not wholly clipped.
struct ActiveBox {
  std::int64_t block_count = 0;
  math::IndexBox cells;  // box around these blocks; empty if there are none
};
// O(blocks of the volume). REQUIRES: isovalues are finite.
ActiveBox ActiveBoxOf(const volume::BlockLayout& layout, const volume::RangeTable& ranges,
                      const std::vector<volume::InsideRule>& rules,
                      const view::Clipper& clipper = {});
// The same of a shard's volume. One with more than `max_dense_blocks` blocks is asked by its octree of
// spans; errors are those of ShardReader::ActiveTree.
absl::StatusOr<ActiveBox> ActiveBoxOf(const store::ShardReader& reader,
                                      const std::vector<volume::InsideRule>& rules,
                                      const view::Clipper& clipper,
                                      std::int64_t max_dense_blocks = volume::kMaxDenseBlocks);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_HISTOGRAM_H_
