#include "tests/support/interval_tree.h"

#include <algorithm>
#include <cstdint>

#include "core/base/status_macros.h"
#include "core/index/interval_tree_builder.h"
#include "tests/support/temp_dir.h"

namespace isoscope::testing {

absl::Status BuildIntervalTree(const std::vector<index::BlockInterval>& intervals,
                               io::WritableFile* file) {
  constexpr std::int64_t kBytesPerInterval = 256;
  const TempDir scratch;
  index::IntervalTreeBuilder::Options options;
  options.scratch_directory = scratch.path();
  options.memory_bytes = std::max(options.memory_bytes,
                                  kBytesPerInterval * static_cast<std::int64_t>(intervals.size()));
  index::IntervalTreeBuilder builder(options);
  for (const index::BlockInterval& interval : intervals) {
    ISOSCOPE_RETURN_IF_ERROR(builder.Add(interval));
  }
  return builder.Finish(file);
}

}  // namespace isoscope::testing
