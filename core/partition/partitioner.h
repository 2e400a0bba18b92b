// Cuts a source volume into blocks, deals them out to shards, and writes a dataset directory.

#ifndef ISOSCOPE_CORE_PARTITION_PARTITIONER_H_
#define ISOSCOPE_CORE_PARTITION_PARTITIONER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/math/vec.h"
#include "core/source/volume_source.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"

namespace isoscope::partition {

struct PartitionProgress {
  const char* phase = "";  // "reading ranges", "writing blocks", "building index"
  std::int64_t done_bytes = 0;
  std::int64_t total_bytes = 0;  // of source samples, over all passes
};

struct PartitionOptions {
  std::string output_directory;             // must not exist; its parent must
  int shard_count = 1;                      // 1 .. min(kMaxShardCount, number of blocks)
  std::optional<math::Index3> block_cells;  // default: volume::DefaultBlockCells
  store::Distribution distribution = store::Distribution::kRandom;
  // Blocks are compressed after their shard was written: needs disk space for one shard twice.
  store::BlockEncoding compression = store::BlockEncoding::kRaw;
  std::uint64_t seed = 1;
  std::int64_t memory_limit_bytes = base::kGiB;
  std::int64_t reserved_bytes = 0;  // of the limit, for what the process holds beside
  std::function<void(const PartitionProgress&)> progress;  // may be null; called from this thread
};

// Streams the volume once (random) or twice (greedy: ranges first) in portions that keep memory
// under the limit (partition_plan.h): what this call and the source allocate, and reserved_bytes.
// With the random distribution no table grows with the number of blocks: what is known of each
// block (90 bytes at most) lies in scratch files without a name, in the output, until it is
// written; the greedy one holds two samples and 14 bytes a block while it deals blocks out, 2 bytes
// afterwards. Crash-safe: everything is written to "<output>.partial-<pid>", flushed, and renamed
// at the end; an error or a cancellation removes it. Deterministic: the same source and options
// give the same bytes, whatever the limit and the number of threads. INVALID_ARGUMENT: bad options
// (more shards than blocks, a memory limit too small for one row of blocks: says what is needed).
// ALREADY_EXISTS: the output exists. RESOURCE_EXHAUSTED: disk full.
absl::StatusOr<store::Manifest> Partition(source::VolumeSource& source,
                                          const PartitionOptions& options,
                                          const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PARTITIONER_H_
