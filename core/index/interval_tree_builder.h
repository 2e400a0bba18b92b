// Bulk-builds the external interval tree of a shard, in memory or in a stated memory.

#ifndef ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/base/file.h"
#include "core/base/units.h"
#include "core/index/interval_tree.h"

namespace isoscope::index {

// Writes the tree of `intervals` (any order; empty spans are left out: they are never active) to
// `file` and closes it. The same set of intervals gives the same bytes. O(N log N) time, O(N)
// memory: about 100 bytes an interval. INVALID_ARGUMENT for more than 2^29 intervals; otherwise the
// file's errors.
absl::Status BuildIntervalTree(std::vector<BlockInterval> intervals, base::WritableFile* file);

// The same tree, byte for byte, of any number of intervals in bounded memory: Add every interval,
// then Finish. Sets that need more than `memory_bytes` (128 bytes an interval) are sorted and cut
// in scratch files without a name, which need up to 170 bytes of disk an interval and are gone with
// the builder, however it ends. O(N / B log_M/B N / B) reads and writes of pages of B intervals.
// Thread-compatible.
class IntervalTreeBuilder {
 public:
  struct Options {
    std::string scratch_directory;                     // exists
    std::int64_t memory_bytes = 24 * base::kMiB;       // of all tables and buffers together
    const base::Cancellation* cancellation = nullptr;  // may be null; outlives the builder
  };

  // What a builder of `interval_count` intervals needs, and no more: with the default memory, at
  // most that.
  static std::int64_t MemoryBytes(std::int64_t interval_count);

  explicit IntervalTreeBuilder(const Options& options);
  ~IntervalTreeBuilder();

  // Errors: the scratch file's (RESOURCE_EXHAUSTED if the disk is full).
  absl::Status Add(const BlockInterval& interval);
  // Writes the tree and closes `file`. INVALID_ARGUMENT for more than 2^29 intervals, CANCELLED;
  // otherwise the files' errors. A file that was not finished is no tree.
  absl::Status Finish(base::WritableFile* file);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
