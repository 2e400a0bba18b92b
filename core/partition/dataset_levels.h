// Adds levels to datasets that exist, and drops them.

#ifndef ISOSCOPE_CORE_PARTITION_DATASET_LEVELS_H_
#define ISOSCOPE_CORE_PARTITION_DATASET_LEVELS_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/partition/level_plan.h"
#include "core/partition/partitioner.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_format.h"

namespace isoscope::partition {

struct AddLevelsOptions {
  LevelOptions levels{.highest = LevelOptions::kAuto};
  store::BlockEncoding compression = store::BlockEncoding::kRaw;  // of the levels
  std::int64_t memory_limit_bytes = base::kGiB;
  std::int64_t reserved_bytes = 0;  // of the limit, for the rest of the process
  std::function<void(const PartitionProgress&)> progress{};  // may be null; called from this thread
  // Opens the source of an index-only dataset, and the memory that it takes, of the limit.
  store::OpenSamples open_samples{};
  std::int64_t source_bytes = 0;
};

// Adds levels to a dataset of one volume or to all volumes of a series, whose shards are all there,
// and returns the highest one of any volume: 0 if kAuto makes none. Files and samples are those
// that partitioning with these levels would have written. Volumes that have these levels already
// are left as they are.
//
// Memory: 28 bytes a block and the range table of one volume, beside what partitioning takes.
//
// Crash-safe: levels are written beside the dataset's files, and only the manifests are replaced,
// each in one step. A process that is killed leaves a dataset that can be drawn, and the next one
// begins with the first volume that is not finished. Agents that serve the dataset go on.
//
// NOT_FOUND: no dataset, or a shard or volume is missing. ALREADY_EXISTS: a volume has other levels.
// FAILED_PRECONDITION: another process writes there, appending was interrupted, or a manifest has
// members that this program does not know. Otherwise errors as Partition.
absl::StatusOr<int> AddLevels(const std::string& directory, const AddLevelsOptions& options,
                              const base::Cancellation& cancellation);

// Removes all levels of the shards that are there: from the manifests first, then their folders.
// OK if there are none. Errors as AddLevels.
absl::Status DropLevels(const std::string& directory, const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_DATASET_LEVELS_H_
