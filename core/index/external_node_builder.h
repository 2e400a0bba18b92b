// Builds a subtree of intervals that are in a scratch file, in a stated memory.

#ifndef ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/index/interval_tree_builder.h"
#include "core/io/page_file.h"
#include "core/io/scratch_file.h"
#include "core/io/scratch_records.h"

namespace isoscope::index {

// What the in-memory builder needs for an interval: its place in the sorted input, a copy, two
// endpoints, two parts, and the lists.
inline constexpr std::int64_t kBytesPerInterval = 128;

// How the memory of an external build is divided. The phases follow each other; in each there are
// at most one sorter, one set of buckets and two sequences.
struct MemoryPlan {
  explicit MemoryPlan(std::int64_t memory_bytes);

  std::int64_t sorter_bytes;
  std::int64_t bucket_bytes;  // each of kMaxSlabs + 1
  std::int64_t sequence_bytes;
  std::int64_t in_memory_count;  // intervals that the in-memory builder takes
};

// Writes the subtree of the intervals of `range` in `file`, which lie there in canonical order, and
// returns the page of its root. CANCELLED; otherwise the errors of scratch files and of `pages`.
absl::StatusOr<io::PageNumber> BuildNodeExternally(const io::ScratchFile& file,
                                                   const io::ScratchRange& range,
                                                   const IntervalTreeBuilder::Options& options,
                                                   io::PageFileWriter* pages);

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_
