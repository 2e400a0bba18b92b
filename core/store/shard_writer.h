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

#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// Life: Create, WriteBlock for every block (any order), AppendIndexEntry for every block by
// ordinal, Finish; then the caller writes the interval tree beside it and, once all shards of the
// dataset are known, calls WriteDescriptions. WriteBlock may run beside itself in another writer,
// not in the same one: thread-compatible. Memory: the buffers of two files, whatever the number of
// blocks.
//
// A block's place in the shard is its ordinal: its rank, among the shard's blocks, in the order of
// BlockOrderKey (block_order.h). Blocks lie without gaps, so a block's offset is the sum of the
// stored sizes of those before it.
class ShardWriter {
 public:
  using CreateFile =
      std::function<absl::StatusOr<std::unique_ptr<io::WritableFile>>(const std::string& path)>;

  // Creates `directory` (its parent must exist, it must not) and the block file in it.
  // `create_file` makes each file: tests inject faults. After an error of this or a later call the
  // directory is left for the caller to remove.
  static absl::StatusOr<std::unique_ptr<ShardWriter>> Create(
      const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
      CreateFile create_file = io::CreateWritableFile);

  // Writes a block at its offset and returns the CRC-32C of its samples, for the index.
  // `samples`: StoredSizeBytes(layout, id, type) bytes. INVALID_ARGUMENT if the id or the size is
  // wrong.
  absl::StatusOr<std::uint32_t> WriteBlock(volume::BlockId id, std::int64_t offset,
                                           absl::string_view samples);

  // Appends the entry of the next ordinal to the block index. The first call ends the writing of
  // blocks. INVALID_ARGUMENT unless ids come in their order, each once.
  absl::Status AppendIndexEntry(volume::BlockId id, std::uint32_t crc32c);

  // Flushes both files. INTERNAL if what was written and what the index says differ in size.
  absl::StatusOr<ShardSummary> Finish();

 private:
  ShardWriter() = default;

  std::string directory_;
  CreateFile create_file_;
  volume::BlockLayout layout_;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::unique_ptr<io::WritableFile> blocks_file_;
  std::int64_t written_block_count_ = 0;

  std::unique_ptr<io::WritableFile> index_file_;  // null before the first entry
  std::int64_t block_count_ = 0;                  // in the index, as all below
  std::int64_t block_bytes_ = 0;
  std::uint32_t entries_crc32c_ = 0;
  volume::BlockId last_id_ = 0;
};

// The blocks of each shard in the order of BlockOrderKey. shard_of_block[id] is in
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

// Writes a ranges.bin piece by piece: the same bytes as EncodeRangeTable, without the table in
// memory. Thread-compatible.
class RangeTableWriter {
 public:
  // Creates `path`, which must not exist.
  static absl::StatusOr<std::unique_ptr<RangeTableWriter>> Create(const std::string& path,
                                                                  volume::ScalarType type);

  // The ranges of the next blocks by id. REQUIRES: of the same type.
  absl::Status Append(const volume::RangeTable& part);
  // Writes the header, flushes the file, and returns the CRC-32C of the whole of it.
  absl::StatusOr<std::uint32_t> Finish();

 private:
  RangeTableWriter() = default;

  std::string path_;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::unique_ptr<io::WritableFile> file_;
  std::int64_t block_count_ = 0;
  std::uint32_t entries_crc32c_ = 0;
};

// Writes the manifest into `directory` (a dataset or shard directory); with shard_index >= 0 also
// the file that says which shard it is. The range table must lie there already, and for a shard the
// interval tree, which is read once for its checksum. The manifest comes last, in one step.
// NOT_FOUND if one of them does not; ALREADY_EXISTS if the directory is described already.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               int shard_index);
// The same, after it wrote the range table.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
