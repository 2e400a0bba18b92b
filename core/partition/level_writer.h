// Writes the levels of a volume, one after the other, each from the one below. Internal to
// partitioning; the tests of the partitioner cover it.

#ifndef ISOSCOPE_CORE_PARTITION_LEVEL_WRITER_H_
#define ISOSCOPE_CORE_PARTITION_LEVEL_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/level_plan.h"
#include "core/partition/level_spool.h"
#include "core/partition/partitioner.h"
#include "core/store/manifest.h"

namespace isoscope::partition {

// INVALID_ARGUMENT, with the limit that is needed, if a level does not fit the memory limit of the
// options. Their cut must be that of the volume.
absl::Status CheckLevelsFit(const volume::GridGeometry& geometry, volume::ScalarType type,
                            const LevelPlan& levels, const PartitionOptions& options);

// Creates the spool of level 1 of a volume; null if no levels are planned.
absl::StatusOr<std::unique_ptr<LevelSpool>> CreateSpoolOfLevel1(
    const std::string& directory, const volume::GridGeometry& geometry, volume::ScalarType type,
    const LevelPlan& levels);

// Writes levels 1 to levels.highest into level_1, level_2, ... of each shard's folder, and returns
// them for the manifest of level 0.
//
// base:              manifest of level 0; only its levels may be missing
// shard_directories: folders of level 0, by shard index, on the file system of `directory`
// directory:         for the work, removed behind it; exists
// level1:            all samples of level 1
// options:           memory, compression and progress; the cut is that of `base`
absl::StatusOr<std::vector<store::LevelSummary>> WriteLevels(
    const store::Manifest& base, const std::vector<std::string>& shard_directories,
    const std::string& directory, const LevelPlan& levels, std::unique_ptr<LevelSpool> level1,
    const PartitionOptions& options, const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_LEVEL_WRITER_H_
