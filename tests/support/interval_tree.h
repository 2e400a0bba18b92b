// An interval tree in one call, for tests.

#ifndef ISOSCOPE_TESTS_SUPPORT_INTERVAL_TREE_H_
#define ISOSCOPE_TESTS_SUPPORT_INTERVAL_TREE_H_

#include <vector>

#include "absl/status/status.h"

#include "core/index/interval_tree.h"
#include "core/io/file.h"

namespace isoscope::testing {

// Writes the tree of `intervals` with an index::IntervalTreeBuilder that has memory for all of them
// at once, and closes `file`. Errors as IntervalTreeBuilder.
absl::Status BuildIntervalTree(const std::vector<index::BlockInterval>& intervals,
                               io::WritableFile* file);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_INTERVAL_TREE_H_
