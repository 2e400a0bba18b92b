// Bulk-builds the external interval tree of a shard in a stated memory.

#ifndef ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
#define ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/index/interval_tree.h"
#include "core/io/file.h"

namespace isoscope::index {

// Writes the tree of any number of intervals in bounded memory: Add every interval (any order;
// empty spans are left out: they are never active), then Finish. The same set of intervals gives
// the same bytes. Sets that need more than `memory_bytes` (128 bytes an interval) are sorted and
// cut in scratch files without a name, which need up to 170 bytes of disk an interval and are gone
// with the builder, however it ends. O(N / B log_M/B N / B) reads and writes of pages of B
// intervals. Thread-compatible.
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
  absl::Status Finish(io::WritableFile* file);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
