// Builds a subtree of intervals that are in memory.

#ifndef ISOSCOPE_CORE_INDEX_IN_MEMORY_NODE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_IN_MEMORY_NODE_BUILDER_H_

#include <span>

#include "absl/status/statusor.h"

#include "core/index/interval_tree.h"
#include "core/io/page_file.h"

namespace isoscope::index {

// Writes the subtree of `intervals` and returns the page of its root.
//
// intervals: in canonical order (lo, hi, block id, ordinal) on entry; reordered
// pages:     appended to; errors are its own
//
// O(n log n) for each level. Allocates up to kBytesPerInterval for an interval, `intervals`
// included (external_node_builder.h).
absl::StatusOr<io::PageNumber> BuildNodeInMemory(std::span<BlockInterval> intervals,
                                                 io::PageFileWriter* pages);

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_IN_MEMORY_NODE_BUILDER_H_
