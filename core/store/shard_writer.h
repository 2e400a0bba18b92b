// Writes one shard directory: blocks, block index, and at the end the descriptions that make it
// readable. A directory without them can't be opened.

#ifndef ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
#define ISOSCOPE_CORE_STORE_SHARD_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/file.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// Life: Create, WriteBlock for every block (any order), FinishBlocks, then, once all shards of the
// dataset are known, WriteShardDescription. Thread-compatible.
//
// A block's place in the shard is its ordinal: its rank in `blocks`, which is in Morton order.
class ShardWriter {
 public:
  // Creates `directory` (its parent must exist, it must not) and the block file in it.
  static absl::StatusOr<std::unique_ptr<ShardWriter>> Create(
      const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
      std::vector<volume::BlockId> blocks);

  // `samples`: StoredSizeBytes(layout, blocks[ordinal], type) bytes. Each ordinal once.
  absl::Status WriteBlock(std::uint32_t ordinal, absl::string_view samples);

  // Writes the block index and flushes both files. INTERNAL if a block is missing.
  absl::StatusOr<ShardSummary> FinishBlocks();

 private:
  ShardWriter() = default;

  struct Entry {
    std::int64_t offset = 0;
    std::uint32_t size = 0;
    std::uint32_t crc32c = 0;
    bool is_written = false;
  };

  std::string directory_;
  std::vector<volume::BlockId> blocks_;
  std::vector<Entry> entries_;  // by ordinal
  std::unique_ptr<base::WritableFile> blocks_file_;
};

// The blocks of each shard in Morton order of their block index. shard_of_block[id] is in
// [0, shard_count).
std::vector<std::vector<volume::BlockId>> BlocksByShard(const volume::BlockLayout& layout,
                                                        const std::vector<std::uint16_t>& shard_of_block,
                                                        int shard_count);

// A digest (32 hex digits) of everything in `manifest` but its dataset_id and name.
std::string ComputeDatasetId(const Manifest& manifest);

// The bytes of ranges.bin.
std::string EncodeRangeTable(const volume::RangeTable& ranges);
// DATA_LOSS if damaged. `where` names the file in messages.
absl::StatusOr<volume::RangeTable> DecodeRangeTable(absl::string_view bytes,
                                                    absl::string_view where);

// Writes manifest and range table into `directory` (a dataset or shard directory); with
// shard_index >= 0 also the file that says which shard it is. The manifest comes last.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
