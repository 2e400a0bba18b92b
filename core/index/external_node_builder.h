// Builds a subtree of the interval tree in a stated memory, from intervals in a scratch file.

#ifndef ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/index/interval_tree_builder.h"
#include "core/io/page_file.h"
#include "core/io/scratch_file.h"
#include "core/io/scratch_records.h"

namespace isoscope::index {

// Memory of the in-memory builder for each interval: the interval itself, a copy, two endpoints,
// its slabs twice, and the lists.
inline constexpr std::int64_t kBytesPerInterval = 128;

// Divides the memory of an external build. Its steps run one after the other; each holds at most
// one sorter, one set of buckets and two sequences.
struct MemoryPlan {
  explicit MemoryPlan(std::int64_t memory_bytes);

  std::int64_t sorter_bytes;
  std::int64_t bucket_bytes;     // buffer of one bucket; there are at most kMaxSlabs + 1
  std::int64_t sequence_bytes;   // buffer of one sequence that is read or written
  std::int64_t in_memory_count;  // a node of at most this many intervals is built in memory
};

// Writes the subtree of the intervals of `range` in `file` and returns the page of its root.
//
// file, range: BlockInterval records in canonical order (lo, hi, block id, ordinal)
// options:     memory_bytes bounds all tables and buffers; scratch files go to scratch_directory
// pages:       appended to
//
// CANCELLED; otherwise the errors of scratch files and of `pages`.
absl::StatusOr<io::PageNumber> BuildNodeExternally(const io::ScratchFile& file,
                                                   const io::ScratchRange& range,
                                                   const IntervalTreeBuilder::Options& options,
                                                   io::PageFileWriter* pages);

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_EXTERNAL_NODE_BUILDER_H_
