// Cuts a source volume into blocks, deals them out to shards, and writes a dataset directory.

#ifndef ISOSCOPE_CORE_INGEST_PARTITIONER_H_
#define ISOSCOPE_CORE_INGEST_PARTITIONER_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/ingest/volume_source.h"
#include "core/math/vec.h"
#include "core/store/manifest.h"

namespace isoscope::ingest {

struct PartitionProgress {
  const char* phase = "";  // "reading ranges", "writing blocks", "building index"
  std::int64_t done_bytes = 0;
  std::int64_t total_bytes = 0;  // of source samples, over all passes
};

struct PartitionOptions {
  std::string output_directory;  // must not exist; its parent must
  int shard_count = 1;           // 1 .. min(kMaxShardCount, number of blocks)
  math::Index3 block_cells{16, 16, 16};
  store::Distribution distribution = store::Distribution::kRandom;
  std::uint64_t seed = 1;
  std::int64_t memory_limit_bytes = base::kGiB;
  std::function<void(const PartitionProgress&)> progress;  // may be null; called from this thread
};

// Streams the volume once (random) or twice (greedy: ranges first) in slabs that keep memory under
// the limit. Crash-safe: everything is written to "<output>.partial-<pid>", flushed, and renamed at
// the end; an error or a cancellation removes it. Deterministic: the same source and options give
// the same bytes.
// INVALID_ARGUMENT: bad options (more shards than blocks, a memory limit too small for one layer of
// blocks: says what is needed). ALREADY_EXISTS: the output exists. RESOURCE_EXHAUSTED: disk full.
absl::StatusOr<store::Manifest> Partition(VolumeSource& source, const PartitionOptions& options,
                                          const base::Cancellation& cancellation);

}  // namespace isoscope::ingest

#endif  // ISOSCOPE_CORE_INGEST_PARTITIONER_H_
