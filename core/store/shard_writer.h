// Writes one shard directory: blocks, block index, and at the end the descriptions (shard.json,
// manifest.json), without which the directory can't be opened. The order of steps is at the head of
// shard_writer.cc. Part of partitioning.

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
#include "absl/types/span.h"

#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// Call Create, then WriteBlock or AppendBlock for every block in any order, then AppendIndexEntry
// for every block by ordinal, then Finish. The caller then writes the interval tree beside them
// and, once all shards of the dataset are known, calls WriteDescriptions.
//
// A block's ordinal is its rank among the shard's blocks in the order of BlockOrderKey
// (block_order.h). Blocks lie without gaps, so a block's offset is the sum of the stored sizes of
// those before it. Raw blocks can be written there at once. Those of other encodings are appended,
// and copied into their order afterwards, if they came in another.
//
// Memory: file buffers and one block, whatever the number of blocks. Thread-compatible.
class ShardWriter {
 public:
  using CreateFile =
      std::function<absl::StatusOr<std::unique_ptr<io::WritableFile>>(const std::string& path)>;

  // Creates `directory` and the block file in it. The parent must exist, `directory` must not.
  // `create_file` creates each file; tests inject faults here. After an error of this or a later
  // call, the caller removes the directory.
  static absl::StatusOr<std::unique_ptr<ShardWriter>> Create(
      const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
      CreateFile create_file = io::CreateWritableFile);

  // Writes a block and returns the CRC-32C of its samples, for AppendIndexEntry.
  //
  // offset:  in blocks.bin, bytes: the stored sizes of all blocks of lower ordinal
  // samples: StoredSizeBytes(layout, id, type) bytes
  //
  // INVALID_ARGUMENT if the id or the size is wrong; otherwise the file's errors.
  absl::StatusOr<std::uint32_t> WriteBlock(volume::BlockId id, std::int64_t offset,
                                           absl::string_view samples);
  // The same for blocks of successive ordinals, in one write. `offset` is that of the first one,
  // and `samples` has all of them, one after the other.
  absl::Status WriteBlocks(absl::Span<const volume::BlockId> ids, std::int64_t offset,
                           absl::string_view samples, absl::Span<std::uint32_t> crcs);

  // Writes an encoded block behind those before, and returns its offset for AppendIndexEntry.
  // INVALID_ARGUMENT if the id is wrong; otherwise the file's errors. REQUIRES: no block of this
  // shard was or is written by WriteBlock.
  absl::StatusOr<std::int64_t> AppendBlock(volume::BlockId id, absl::string_view stored);

  // Appends the entry of the next ordinal to the block index, for a block of WriteBlock or of
  // AppendBlock. No block can be written after the first call. INVALID_ARGUMENT unless ids come in
  // BlockOrderKey order, each once; otherwise the files' errors.
  //
  // entry: of AppendBlock, whose offset it has; its raw size does not count
  absl::Status AppendIndexEntry(volume::BlockId id, std::uint32_t crc32c);
  absl::Status AppendIndexEntry(BlockIndexEntry entry);

  // Writes the header of the index and flushes it. INTERNAL if the blocks that were written differ
  // from those of the index in number or size.
  absl::StatusOr<ShardSummary> Finish();

 private:
  ShardWriter() = default;
  absl::Status StartIndex();
  absl::Status CopyBlock(const BlockIndexEntry& entry);

  std::string directory_;
  CreateFile create_file_;
  volume::BlockLayout layout_;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::unique_ptr<io::WritableFile> blocks_file_;
  std::int64_t written_block_count_ = 0;
  std::uint64_t last_key_ = 0;  // of the blocks that were appended
  bool is_ordered_ = true;      // so they were appended by ordinal

  // The blocks in the order in which they were appended, while they are copied; otherwise null.
  std::unique_ptr<io::RandomAccessFile> unordered_file_;
  std::string block_;

  std::unique_ptr<io::WritableFile> index_file_;  // null before the first entry
  std::int64_t block_count_ = 0;                  // entries in the index; so for all below
  std::int64_t block_bytes_ = 0;
  std::uint32_t entries_crc32c_ = 0;
  volume::BlockId last_id_ = 0;
};

// Returns the blocks of each shard in the order of BlockOrderKey: result[shard][ordinal].
// shard_of_block: by block id, each in [0, shard_count)
std::vector<std::vector<volume::BlockId>> BlocksByShard(
    const volume::BlockLayout& layout, const std::vector<std::uint16_t>& shard_of_block,
    int shard_count);

// Returns a digest, 32 hex digits, of everything in `manifest` but its dataset_id and name.
std::string ComputeDatasetId(const Manifest& manifest);

// Returns the bytes of ranges.bin.
std::string EncodeRangeTable(const volume::RangeTable& ranges);
// Decodes a ranges.bin. DATA_LOSS if it is damaged. `where` names the file in messages.
absl::StatusOr<volume::RangeTable> DecodeRangeTable(absl::string_view bytes,
                                                    absl::string_view where);

// Writes a ranges.bin piece by piece: the same bytes as EncodeRangeTable, without the table in
// memory. Thread-compatible.
class RangeTableWriter {
 public:
  // Creates `path`, which must not exist.
  static absl::StatusOr<std::unique_ptr<RangeTableWriter>> Create(const std::string& path,
                                                                  volume::ScalarType type);

  // Appends the ranges of the next blocks by id. REQUIRES: ranges.type() is that of Create.
  absl::Status Append(const volume::RangeTable& ranges);
  // Writes the header, flushes the file, and returns the CRC-32C of the whole file.
  absl::StatusOr<std::uint32_t> Finish();

 private:
  RangeTableWriter() = default;

  std::string path_;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::unique_ptr<io::WritableFile> file_;
  std::int64_t block_count_ = 0;
  std::uint32_t entries_crc32c_ = 0;
};

// Writes the manifest into a dataset directory (shard_index < 0), or the manifest and shard.json
// into a shard directory. The range table must be there already. A shard must also have its
// interval tree. That is read once for its checksum, as is the histogram if there is one. The
// manifest comes last and appears whole. NOT_FOUND if one of the former files is missing;
// ALREADY_EXISTS if the directory has a manifest.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               int shard_index);
// Writes the range table, then does the same.
absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_WRITER_H_
