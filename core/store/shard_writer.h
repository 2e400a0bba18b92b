// Writes one shard directory: blocks, block index, and at the end the descriptions that make it
// readable. A directory without them can't be opened.

#ifndef ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
#define ISOSCOPE_CORE_STORE_SHARD_WRITER_H_

#include <cstdint>
#include <functional>
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

// Life: Create, WriteBlock for every block (any order), FinishBlocks; then the caller writes the
// interval tree beside it and, once all shards of the dataset are known, calls WriteDescriptions.
// Thread-compatible.
//
// A block's place in the shard is its ordinal: its rank in `blocks`, which is in Morton order.
class ShardWriter {
 public:
  using CreateFile =
      std::function<absl::StatusOr<std::unique_ptr<base::WritableFile>>(const std::string& path)>;

  // Creates `directory` (its parent must exist, it must not) and the block file in it.
  // `create_file` makes each file: tests inject faults. INVALID_ARGUMENT unless `blocks` are ids of
  // the layout in Morton order, each once. After an error of this or a later call the directory is
  // left for the caller to remove.
  static absl::StatusOr<std::unique_ptr<ShardWriter>> Create(
      const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
      std::vector<volume::BlockId> blocks, CreateFile create_file = base::CreateWritableFile);

  // `samples`: StoredSizeBytes(layout, blocks[ordinal], type) bytes. Each ordinal once.
  // INVALID_ARGUMENT if the ordinal or the size is wrong, INTERNAL if it was written before.
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
  CreateFile create_file_;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::vector<volume::BlockId> blocks_;
  std::vector<Entry> entries_;  // by ordinal
  std::int64_t block_bytes_ = 0;
  std::unique_ptr<base::WritableFile> blocks_file_;
};

// The blocks of each shard in Morton order of their block index. shard_of_block[id] is in
// [0, shard_count).
std::vector<std::vector<volume::BlockId>> BlocksByShard(
    const volume::BlockLayout& layout, const std::vector<std::uint16_t>& shard_of_block,
    int shard_count);

// A digest (32 hex digits) of everything in `manifest` but its dataset_id and name.
std::string ComputeDatasetId(const Manifest& manifest);

// The bytes of ranges.bin.
std::string EncodeRangeTable(const volume::RangeTable& ranges);
// DATA_LOSS if damaged. `where` names the file in messages.
absl::StatusOr<volume::RangeTable> DecodeRangeTable(absl::string_view bytes,
                                                    absl::string_view where);

// Writes manifest and range table into `directory` (a dataset or shard directory); with
// shard_index >= 0 also the file that says which shard it is. The manifest comes last, in one step.
// For a shard, the interval tree must lie in `directory` already: it is read once for its checksum.
// NOT_FOUND if it does not; ALREADY_EXISTS if the directory is described already.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
