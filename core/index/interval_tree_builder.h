// Bulk-builds the external interval tree of a shard in a stated memory. Used by partitioning.

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

// Writes the tree of any number of intervals. Add every interval, in any order, then call Finish.
// Empty spans are never active and are left out. The same set of intervals gives the same bytes.
//
// A set that needs more than `memory_bytes`, at 128 bytes an interval, is sorted and cut in scratch
// files without a name. They take up to 170 bytes of disk an interval and vanish with the builder,
// even if the process is killed. O(N / B log_M/B N / B) page reads and writes.
//
// Thread-compatible.
class IntervalTreeBuilder {
 public:
  struct Options {
    std::string scratch_directory;                     // must exist
    std::int64_t memory_bytes = 24 * base::kMiB;       // of all tables and buffers together
    const base::Cancellation* cancellation = nullptr;  // may be null; outlives the builder
  };

  // Returns the bytes with which `interval_count` intervals are built in memory, or the default
  // memory if that is less.
  static std::int64_t MemoryBytes(std::int64_t interval_count);

  explicit IntervalTreeBuilder(const Options& options);
  ~IntervalTreeBuilder();

  // Adds an interval. Errors: the scratch file's (RESOURCE_EXHAUSTED if the disk is full).
  absl::Status Add(const BlockInterval& interval);
  // Writes the tree and closes `file`. INVALID_ARGUMENT for more than 2^29 intervals, CANCELLED;
  // otherwise the files' errors. After an error the file has no header: opening it fails.
  absl::Status Finish(io::WritableFile* file);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_BUILDER_H_
