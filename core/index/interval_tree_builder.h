// Bulk-builds the external interval tree of a shard.

#ifndef ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_

#include <vector>

#include "absl/status/status.h"

#include "core/base/file.h"
#include "core/index/interval_tree.h"

namespace isoscope::index {

// Writes the tree of `intervals` (any order; empty spans are left out: they are never active) to
// `file` and closes it. The same set of intervals gives the same bytes. O(N log N) time, O(N)
// memory: about 100 bytes an interval. INVALID_ARGUMENT for more than 2^29 intervals; otherwise the
// file's errors.
absl::Status BuildIntervalTree(std::vector<BlockInterval> intervals, base::WritableFile* file);

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
