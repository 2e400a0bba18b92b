// One opened shard: its blocks and its index.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/extract/block_shape.h"
#include "core/index/interval_tree.h"
#include "core/io/file.h"
#include "core/store/directory_files.h"
#include "core/store/shard_reader.h"

namespace isoscope::agent {

// Immutable; thread-safe.
struct Shard {
  std::uint32_t number = 0;  // unique among the shards that this process has opened
  std::unique_ptr<store::ShardReader> reader;
  std::unique_ptr<index::IntervalTree> tree;
  std::shared_ptr<const extract::BlockShapes> shapes;  // for the extraction of its blocks
  // Levels 1, 2, ...; null where the shard lacks one. Only of OpenShardWithLevels.
  std::vector<std::shared_ptr<const Shard>> levels = {};
};

// Shards of one dataset, unless said otherwise.
using Shards = std::vector<std::shared_ptr<const Shard>>;

// Returns a number that no shard of this process has yet.
std::uint32_t NextShardNumber();

// Opens a shard directory. Reads its tables and some pages of its index, no block. Errors as
// ShardReader::Open and IntervalTree::Open; DATA_LOSS also if the index does not belong to the
// blocks.
//
// number: Shard::number; that of an earlier opening only if the contents are the same
// open_file, open_samples: as for ShardReader::Open
absl::StatusOr<std::shared_ptr<const Shard>> OpenShard(
    const std::string& directory, std::uint32_t number = NextShardNumber(),
    const store::OpenFile& open_file = io::OpenRandomAccessFile,
    const store::OpenSamples& open_samples = nullptr);

// Opens a level >= 1 of a shard: a shard of its own, of stored values (core/store/shard_levels.h).
// FAILED_PRECONDITION if the shard lacks it. Other errors as OpenShard.
absl::StatusOr<std::shared_ptr<const Shard>> OpenLevel(
    const Shard& shard, int level, std::uint32_t number = NextShardNumber(),
    const store::OpenFile& open_file = io::OpenRandomAccessFile);

// Opens a shard with its levels. One that is missing or damaged is logged, and left out: the rest
// can be drawn. Errors as OpenShard.
absl::StatusOr<std::shared_ptr<const Shard>> OpenShardWithLevels(
    const std::string& directory, const store::OpenFile& open_file = io::OpenRandomAccessFile,
    const store::OpenSamples& open_samples = nullptr);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_H_
