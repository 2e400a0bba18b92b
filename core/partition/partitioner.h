// Cuts a source volume into blocks, distributes them to shards, and writes a dataset directory.

#ifndef ISOSCOPE_CORE_PARTITION_PARTITIONER_H_
#define ISOSCOPE_CORE_PARTITION_PARTITIONER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/math/vec.h"
#include "core/partition/level_plan.h"
#include "core/source/volume_source.h"
#include "core/store/manifest.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_format.h"
#include "core/volume/label.h"

namespace isoscope::partition {

struct PartitionProgress {
  // "reading ranges", "writing blocks", "building index", "writing levels"
  const char* phase = "";
  std::int64_t done_bytes = 0;
  std::int64_t total_bytes = 0;  // of samples, over all passes and levels
};

struct PartitionOptions {
  std::string output_directory;             // must not exist; its parent must
  std::string name;                         // of the dataset; empty: that of the folder
  std::string source_name;                  // for people; empty: file name of the source
  int shard_count = 1;                      // 1 .. min(kMaxShardCount, number of blocks)
  std::optional<math::Index3> block_cells;  // default: volume::DefaultBlockCells
  store::Distribution distribution = store::Distribution::kRandom;
  // Blocks that are encoded: if four layers of blocks are more than 1 GiB, or do not fit in the
  // memory, the disk must hold one shard twice.
  store::BlockEncoding compression = store::BlockEncoding::kRaw;
  std::uint64_t seed = 1;
  std::vector<volume::Label> labels{};  // names and colours of values; volume::ValidateLabels
  LevelOptions levels{};                // coarser volumes beside the samples
  // How the source is opened again: makes an index-only dataset, whose level 0 has no samples. Blocks
  // are dealt out at random by units, and not encoded.
  std::optional<store::SourceSamples> in_source{};
  // The units of in_source stay as they are, as those of all volumes of a series do. Else they are set
  // here (PlanUnits), whatever they are.
  bool keeps_units = false;
  std::int64_t memory_limit_bytes = base::kGiB;
  std::int64_t reserved_bytes = 0;  // of the limit, for the rest of the process
  // Blocks of more bytes than this are written past the page cache. Default: CachedBytes().
  std::optional<std::int64_t> max_cached_bytes{};
  std::function<void(const PartitionProgress&)> progress;  // may be null; called from this thread
  // Asked once all was read, before the output gets its name: an error is returned, and the output
  // removed. May be null. It tells whether the source has changed meanwhile.
  std::function<absl::Status()> check_source{};
};

// Sets the units in which an index-only volume reads its source: the boxes of its grid, or several of
// them if they are small. INVALID_ARGUMENT: a source without random access; boxes of more than
// store::kMaxUnitBytes, with the samples of others that are decoded along with them.
absl::Status PlanUnits(const source::VolumeSource& source, store::SourceSamples* samples);

// INVALID_ARGUMENT: an index-only volume can't have this source, which has no random access.
absl::Status CheckRandomAccess(const source::VolumeSource& source);
// INVALID_ARGUMENT: options that an index-only volume can't have, such as more shards than units.
// REQUIRES: in_source with its units.
absl::Status CheckIndexOnly(const PartitionOptions& options, const volume::BlockLayout& layout);

// Partitions a volume and returns the manifest. Reads the volume once (random) or twice (greedy:
// ranges first); levels are made along with it. The steps are at the head of partitioner.cc.
//
// Memory: this call, the source and reserved_bytes together stay under the limit, by taking the
// volume in portions (partition_plan.h). With the random distribution no table grows with the
// number of blocks; records of up to 90 bytes a block lie in scratch files without a name, in the
// output, as do the samples of two levels at a time. The greedy one holds two samples and 14 bytes a block while it deals blocks out, 2 bytes
// afterwards.
//
// Crash-safe: everything is written to "<output>.partial-XXXXXX", flushed, and renamed at the end.
// An error or a cancellation removes it. Deterministic: the same source and options give the same
// bytes, whatever the limit and the number of threads.
//
// INVALID_ARGUMENT: bad options, such as more shards than blocks, or units of an index-only volume;
// a source that an index-only volume can't have (PlanUnits); a memory limit too small for one row of
// blocks (the message says what is needed). ALREADY_EXISTS: the output exists.
// NOT_FOUND: its parent does not. RESOURCE_EXHAUSTED: the disk is full. CANCELLED.
absl::StatusOr<store::Manifest> Partition(source::VolumeSource& source,
                                          const PartitionOptions& options,
                                          const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PARTITIONER_H_
