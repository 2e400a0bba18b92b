// The levels of a shard on disk (docs/format/dataset.md, "Levels"). Each is a shard of a volume of
// its own, in a folder of the shard of level 0, or of a step's folder of a series:
//
//   shard-00000-of-00002/
//   ├── manifest.json, ranges.bin, shard.json, blocks.bin, ...     level 0
//   ├── level_1/   manifest.json, ranges.bin, shard.json, blocks.bin, ...
//   └── level_2/   ...
//
// Levels are added and dropped by replacing manifest.json of level 0 alone (ManifestCrc32c), so a
// reader sees all levels or none.

#ifndef ISOSCOPE_CORE_STORE_SHARD_LEVELS_H_
#define ISOSCOPE_CORE_STORE_SHARD_LEVELS_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/shard_reader.h"

namespace isoscope::store {

// Returns the folder of a level of a shard: that of the shard for level 0.
std::string LevelDirectory(const std::string& shard_directory, int level);

// Opens a level of a shard and checks that it belongs to it. The reader's manifest is that of the
// level: its geometry, sample type and ranges, of stored values. Opens level 0 if `level` is 0.
//
// shard_directory: of the volume, or of a scalar volume of a series
//
// NOT_FOUND: the shard's manifest has no such level, or its folder is not there; the message says
// which shard lacks which level, and level 0 can be opened all the same. DATA_LOSS: it is damaged,
// or of another dataset. Otherwise errors as ShardReader::Open.
absl::StatusOr<std::unique_ptr<ShardReader>> OpenShardLevel(
    const std::string& shard_directory, int level,
    const ShardReader::OpenFile& open_file = io::OpenRandomAccessFile);

// The same for an open level 0, whose manifest is not read again. REQUIRES: level >= 1.
absl::StatusOr<std::unique_ptr<ShardReader>> OpenLevelOf(
    const ShardReader& shard, int level,
    const ShardReader::OpenFile& open_file = io::OpenRandomAccessFile);

// Returns the levels of `manifest` that a shard lacks, ascending: partitioning and careful copies
// write the manifest of a level's folder last.
std::vector<int> MissingLevels(const std::string& shard_directory, const Manifest& manifest);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_LEVELS_H_
