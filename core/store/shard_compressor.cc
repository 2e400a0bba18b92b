// Rewrites a raw shard in batches of about 8 MiB:
//
//   1. RawBlocks::Next reads the entries of the next blocks and their bytes, which lie one after
//      the other in blocks.bin: one read each.
//   2. Encode the blocks of the batch in parallel, each into a string of its own, with the CRC-32C
//      of the encoded bytes.
//   3. Append them by ordinal to blocks.bin.compressed, and their entries to
//      block_index.bin.compressed. A block's new offset is the sum of the encoded sizes before it.
//
// Then write the header of the new index, close both files and rename them over the raw ones.
//
// Invariants: ordinals do not change, so an interval tree that was built before stays valid. The
// result does not depend on the number of threads or the size of a batch. A batch has at least one
// block and at most kMaxBatchBlocks, which bounds its tables where blocks are tiny.

#include "core/store/shard_compressor.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/block_codec.h"
#include "core/volume/block_samples.h"

namespace isoscope::store {
namespace {

constexpr char kPartialSuffix[] = ".compressed";
constexpr std::size_t kMaxBatchBlocks = 16384;

absl::StatusOr<std::uint32_t> Crc32cOfFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
  std::string buffer(static_cast<std::size_t>(base::kMiB), '\0');
  std::uint32_t crc32c = 0;
  for (std::int64_t offset = 0; offset < file->size_bytes();) {
    const auto size = static_cast<std::size_t>(
        std::min(file->size_bytes() - offset, static_cast<std::int64_t>(buffer.size())));
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(offset, size, buffer.data()));
    crc32c = base::ExtendCrc32c(crc32c, buffer.data(), size);
    offset += static_cast<std::int64_t>(size);
  }
  return crc32c;
}

struct EncodedBlock {
  BlockIndexEntry entry;  // of the raw block, then of the encoded one
  std::string bytes;
};

// Reads a raw shard from its first block to its last. Thread-compatible.
class RawBlocks {
 public:
  // `layout` must outlive it.
  static absl::StatusOr<RawBlocks> Open(const std::string& directory,
                                        const volume::BlockLayout& layout, volume::ScalarType type,
                                        const ShardSummary& raw) {
    RawBlocks blocks;
    blocks.layout_ = &layout;
    blocks.type_ = type;
    ISOSCOPE_ASSIGN_OR_RETURN(blocks.index_file_, io::OpenRandomAccessFile(absl::StrFormat(
                                                      "%s/%s", directory, kBlockIndexFileName)));
    ISOSCOPE_ASSIGN_OR_RETURN(blocks.blocks_file_, io::OpenRandomAccessFile(absl::StrFormat(
                                                       "%s/%s", directory, kBlocksFileName)));
    blocks.block_count_ = raw.block_count;
    const std::int64_t index_bytes =
        static_cast<std::int64_t>(kBinaryHeaderBytes) +
        static_cast<std::int64_t>(kBlockIndexEntryBytes) * raw.block_count;
    if (blocks.index_file_->size_bytes() != index_bytes ||
        blocks.blocks_file_->size_bytes() != raw.block_bytes) {
      return absl::DataLossError(
          absl::StrFormat("%s: %d bytes of index and %d of blocks, expected %d and %d", directory,
                          blocks.index_file_->size_bytes(), blocks.blocks_file_->size_bytes(),
                          index_bytes, raw.block_bytes));
    }
    return blocks;
  }

  // Reads the next blocks, at most max_bytes together: their entries to `*batch`, their samples one
  // after the other to `*bytes`. At the end the batch is empty.
  absl::Status Next(std::size_t max_bytes, std::vector<EncodedBlock>* batch, std::string* bytes) {
    batch->clear();
    const auto count = static_cast<std::size_t>(
        std::min(block_count_ - next_, static_cast<std::int64_t>(kMaxBatchBlocks)));
    std::string entries(count * kBlockIndexEntryBytes, '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        index_file_->ReadAt(static_cast<std::int64_t>(kBinaryHeaderBytes) +
                                next_ * static_cast<std::int64_t>(kBlockIndexEntryBytes),
                            entries.size(), entries.data()));
    std::size_t size = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const BlockIndexEntry entry = DecodeBlockIndexEntry(&entries[i * kBlockIndexEntryBytes]);
      if (i > 0 && size + entry.size > max_bytes) {
        break;
      }
      if (entry.encoding != static_cast<std::uint32_t>(BlockEncoding::kRaw) ||
          entry.offset != offset_ + static_cast<std::int64_t>(size) ||
          entry.block_id >= layout_->block_count() || entry.size != entry.raw_size ||
          entry.size != volume::StoredSizeBytes(*layout_, entry.block_id, type_)) {
        return absl::DataLossError(absl::StrFormat("%s: block %d is not the next raw block",
                                                   index_file_->path(), entry.block_id));
      }
      size += entry.size;
      batch->push_back({.entry = entry, .bytes = {}});
    }
    bytes->resize(size);
    ISOSCOPE_RETURN_IF_ERROR(blocks_file_->ReadAt(offset_, size, bytes->data()));
    offset_ += static_cast<std::int64_t>(size);
    next_ += static_cast<std::int64_t>(batch->size());
    return absl::OkStatus();
  }

 private:
  const volume::BlockLayout* layout_ = nullptr;
  volume::ScalarType type_ = volume::ScalarType::kUint8;
  std::unique_ptr<io::RandomAccessFile> index_file_;
  std::unique_ptr<io::RandomAccessFile> blocks_file_;
  std::int64_t block_count_ = 0;
  std::int64_t next_ = 0;    // ordinal
  std::int64_t offset_ = 0;  // of block next_ in blocks.bin
};

// Encodes the blocks of a batch: fills in their bytes, and encoding, size and checksum of their
// entries. `bytes` holds the raw samples of all, one after the other.
void EncodeBatch(BlockEncoding encoding, const volume::BlockLayout& layout, volume::ScalarType type,
                 absl::string_view bytes, ParallelFor parallel_for,
                 std::vector<EncodedBlock>* batch) {
  std::vector<std::size_t> starts;
  starts.reserve(batch->size());
  std::size_t start = 0;
  for (const EncodedBlock& block : *batch) {
    starts.push_back(start);
    start += block.entry.size;
  }
  parallel_for(batch->size(), [&](std::size_t i) {
    EncodedBlock& block = (*batch)[i];
    const absl::string_view samples = bytes.substr(starts[i], block.entry.size);
    const math::Index3 dims = layout.StoredSamplesOf(block.entry.block_id).dims();
    block.entry.encoding =
        static_cast<std::uint32_t>(EncodeBlock(encoding, type, dims, samples, &block.bytes));
    block.entry.size = static_cast<std::uint32_t>(block.bytes.size());
    block.entry.crc32c = base::Crc32c(block.bytes);
  });
}

}  // namespace

absl::StatusOr<ShardSummary> CompressShard(const std::string& directory,
                                           const volume::BlockLayout& layout,
                                           volume::ScalarType type, const ShardSummary& raw,
                                           const CompressOptions& options, ParallelFor parallel_for,
                                           const base::Cancellation& cancellation) {
  const std::string blocks_path = absl::StrFormat("%s/%s", directory, kBlocksFileName);
  const std::string index_path = absl::StrFormat("%s/%s", directory, kBlockIndexFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(RawBlocks raw_blocks, RawBlocks::Open(directory, layout, type, raw));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto blocks_file,
                            options.create_file(blocks_path + kPartialSuffix));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto index_file,
                            options.create_file(index_path + kPartialSuffix));
  // Leaves room for the header, which is known at the end.
  ISOSCOPE_RETURN_IF_ERROR(index_file->Append(std::string(kBinaryHeaderBytes, '\0')));

  ShardSummary summary{.block_count = raw.block_count};
  std::uint32_t entries_crc32c = 0;
  std::vector<EncodedBlock> batch;
  std::string bytes;
  while (true) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_RETURN_IF_ERROR(raw_blocks.Next(options.batch_bytes, &batch, &bytes));
    if (batch.empty()) {
      break;
    }
    EncodeBatch(options.encoding, layout, type, bytes, parallel_for, &batch);
    for (EncodedBlock& block : batch) {
      block.entry.offset = summary.block_bytes;
      ISOSCOPE_RETURN_IF_ERROR(blocks_file->Append(block.bytes));
      const std::string entry = EncodeBlockIndexEntry(block.entry);
      ISOSCOPE_RETURN_IF_ERROR(index_file->Append(entry));
      entries_crc32c = base::ExtendCrc32c(entries_crc32c, entry.data(), entry.size());
      summary.block_bytes += block.entry.size;
    }
  }

  const std::string header =
      EncodeBinaryHeader(kBlockIndexMagic, {.scalar_type = static_cast<std::uint32_t>(type),
                                            .entry_size = kBlockIndexEntryBytes,
                                            .count = summary.block_count,
                                            .payload_crc32c = entries_crc32c,
                                            .data_size = summary.block_bytes});
  ISOSCOPE_RETURN_IF_ERROR(index_file->WriteAt(0, header));
  ISOSCOPE_RETURN_IF_ERROR(blocks_file->Close());
  ISOSCOPE_RETURN_IF_ERROR(index_file->Close());
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(blocks_path + kPartialSuffix, blocks_path));
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(index_path + kPartialSuffix, index_path));
  ISOSCOPE_ASSIGN_OR_RETURN(summary.block_index_crc32c, Crc32cOfFile(index_path));
  return summary;
}

}  // namespace isoscope::store
