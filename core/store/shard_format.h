// Names and constants of a dataset on disk; docs/format/ says what they mean, byte by byte.

#ifndef ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_
#define ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_

#include <string>

#include "absl/strings/str_format.h"

namespace isoscope::store {

// In the dataset directory and in each shard directory.
inline constexpr char kManifestFileName[] = "manifest.json";
inline constexpr char kRangeTableFileName[] = "ranges.bin";
// In a shard directory.
inline constexpr char kBlocksFileName[] = "blocks.bin";
inline constexpr char kBlockIndexFileName[] = "block_index.bin";
inline constexpr char kIntervalTreeFileName[] = "interval_tree.bin";
// Which shard of its dataset a shard directory is: JSON with its own CRC-32C.
inline constexpr char kShardFileName[] = "shard.json";

// "shard-00003-of-00016".
inline std::string ShardDirectoryName(int shard_index, int shard_count) {
  return absl::StrFormat("shard-%05d-of-%05d", shard_index, shard_count);
}

inline constexpr int kMaxShardCount = 65536;

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_
