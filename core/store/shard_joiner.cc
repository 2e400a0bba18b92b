// A slab of blocks is a run of every shard's order, if it begins and ends between cubes
// (block_order.h). So a shard is its pieces, one after the other:
//
//   blocks.bin        the bytes of the pieces
//   block_index.bin   their entries, whose offsets grow by the bytes of the pieces before
//
// An index-only shard has no blocks.bin, nor have its pieces.
//
// The entries and the spans are compared with the record of the piece first. Then blocks are copied
// in runs of some MiB, each compared with the checksums of its entries.

#include "core/store/shard_joiner.h"

#include <algorithm>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/block_order.h"
#include "core/store/shard_format.h"

namespace isoscope::store {
namespace {

constexpr std::int64_t kRunBytes = 8 * base::kMiB;
constexpr std::int64_t kRunBlocks = 16384;
constexpr std::size_t kDirectBytes = std::size_t{1} << 20;  // of a write past the page cache

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

// Writes a shard.
class Joiner {
 public:
  Joiner(const volume::BlockLayout& layout, volume::ScalarType type, bool is_index_only,
         absl::FunctionRef<absl::Status(const JoinedBlock&)> visit,
         const base::Cancellation& cancellation)
      : layout_(layout),
        type_(type),
        is_index_only_(is_index_only),
        visit_(visit),
        cancellation_(cancellation) {}

  absl::Status Create(const std::string& directory, bool is_direct) {
    directory_ = directory;
    if (const std::string path = absl::StrCat(directory, "/", kBlocksFileName); !is_index_only_) {
      ISOSCOPE_ASSIGN_OR_RETURN(blocks_file_, is_direct ? io::CreateDirectFile(path, kDirectBytes)
                                                        : io::CreateWritableFile(path));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        index_file_, io::CreateWritableFile(absl::StrCat(directory, "/", kBlockIndexFileName)));
    return index_file_->Append(std::string(kBinaryHeaderBytes, '\0'));
  }

  absl::Status Add(const PieceOfShard& from) {
    const std::int64_t count = from.piece.summary.block_count;
    const auto open = [&from](absl::string_view name) {
      return io::OpenRandomAccessFile(absl::StrCat(from.directory, "/", name));
    };
    std::unique_ptr<io::RandomAccessFile> blocks;
    if (!is_index_only_) {
      ISOSCOPE_ASSIGN_OR_RETURN(blocks, open(kBlocksFileName));
      ISOSCOPE_RETURN_IF_ERROR(CheckSize(*blocks, from.piece.summary.block_bytes));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const auto index, open(kBlockIndexFileName));
    ISOSCOPE_ASSIGN_OR_RETURN(const auto spans, open(kSpansFileName));
    ISOSCOPE_RETURN_IF_ERROR(CheckSize(
        *index, static_cast<std::int64_t>(
                    kBinaryHeaderBytes + kBlockIndexEntryBytes * static_cast<std::size_t>(count))));
    ISOSCOPE_RETURN_IF_ERROR(CheckSize(*spans, static_cast<std::int64_t>(kSpanBytes) * count));
    ISOSCOPE_RETURN_IF_ERROR(CheckCrc32c(*index, from.piece.summary.block_index_crc32c));
    ISOSCOPE_RETURN_IF_ERROR(CheckCrc32c(*spans, from.piece.spans_crc32c));
    std::string entries;
    std::int64_t offset = 0;  // in the piece
    std::string span_bytes;
    for (std::int64_t first = 0; first < count; first += kRunBlocks) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      const auto run = static_cast<std::size_t>(std::min(kRunBlocks, count - first));
      entries.resize(run * kBlockIndexEntryBytes);
      ISOSCOPE_RETURN_IF_ERROR(
          index->ReadAt(static_cast<std::int64_t>(kBinaryHeaderBytes) +
                            first * static_cast<std::int64_t>(kBlockIndexEntryBytes),
                        entries.size(), entries.data()));
      span_bytes.resize(run * kSpanBytes);
      ISOSCOPE_RETURN_IF_ERROR(spans->ReadAt(first * static_cast<std::int64_t>(kSpanBytes),
                                             span_bytes.size(), span_bytes.data()));
      ISOSCOPE_RETURN_IF_ERROR(AddEntries(entries, span_bytes, blocks.get(), *index, &offset));
    }
    return offset == from.piece.summary.block_bytes ? absl::OkStatus() : Damaged(*index);
  }

  absl::StatusOr<ShardSummary> Finish() {
    const std::string header =
        EncodeBinaryHeader(kBlockIndexMagic, {.scalar_type = static_cast<std::uint32_t>(type_),
                                              .entry_size = kBlockIndexEntryBytes,
                                              .count = summary_.block_count,
                                              .payload_crc32c = entries_crc32c_,
                                              .data_size = summary_.block_bytes});
    ISOSCOPE_RETURN_IF_ERROR(index_file_->WriteAt(0, header));
    if (blocks_file_ != nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Close());
    }
    ISOSCOPE_RETURN_IF_ERROR(index_file_->Close());
    ISOSCOPE_ASSIGN_OR_RETURN(summary_.block_index_crc32c,
                              Crc32cOfFile(absl::StrCat(directory_, "/", kBlockIndexFileName)));
    return summary_;
  }

 private:
  static absl::Status Damaged(const io::RandomAccessFile& file) {
    return absl::DataLossError(
        absl::StrCat(file.path(),
                     ": damaged: its bytes are not those that the part has written; remove the "
                     "part's folder and run the part again"));
  }

  static absl::Status CheckSize(const io::RandomAccessFile& file, std::int64_t expected) {
    if (file.size_bytes() == expected) {
      return absl::OkStatus();
    }
    return absl::DataLossError(absl::StrFormat(
        "%s: %d bytes, expected %d: remove the part's folder and run the part again", file.path(),
        file.size_bytes(), expected));
  }

  static absl::Status CheckCrc32c(const io::RandomAccessFile& file, std::uint32_t expected) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t crc32c, Crc32cOfFile(file.path()));
    return crc32c == expected ? absl::OkStatus() : Damaged(file);
  }

  // Copies the blocks of some entries, in runs. blocks: null if they are in the source
  absl::Status AddEntries(absl::string_view entries, absl::string_view spans,
                          const io::RandomAccessFile* blocks, const io::RandomAccessFile& index,
                          std::int64_t* offset) {
    const std::size_t count = entries.size() / kBlockIndexEntryBytes;
    for (std::size_t begin = 0; begin < count;) {
      std::vector<BlockIndexEntry> run;
      std::int64_t bytes = 0;
      for (std::size_t i = begin; i < count; ++i) {
        const BlockIndexEntry entry =
            DecodeBlockIndexEntry(entries.data() + i * kBlockIndexEntryBytes);
        if (entry.offset != *offset + bytes || entry.block_id >= layout_.block_count()) {
          return Damaged(index);
        }
        if (!run.empty() && bytes + entry.size > kRunBytes) {
          break;
        }
        run.push_back(entry);
        bytes += entry.size;
      }
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      if (blocks != nullptr) {
        buffer_.resize(static_cast<std::size_t>(bytes));
        ISOSCOPE_RETURN_IF_ERROR(blocks->ReadAt(*offset, buffer_.size(), buffer_.data()));
        ISOSCOPE_RETURN_IF_ERROR(VerifyRun(run, *blocks));
        ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Append(buffer_));
      }
      ISOSCOPE_RETURN_IF_ERROR(
          AddRun(run, spans.substr(begin * kSpanBytes, run.size() * kSpanBytes), index));
      *offset += bytes;
      begin += run.size();
    }
    return absl::OkStatus();
  }

  // Compares the blocks in the buffer.
  absl::Status VerifyRun(const std::vector<BlockIndexEntry>& run,
                         const io::RandomAccessFile& blocks) const {
    std::size_t at = 0;
    for (const BlockIndexEntry& entry : run) {
      if (base::Crc32c(absl::string_view(buffer_).substr(at, entry.size)) != entry.crc32c) {
        return Damaged(blocks);
      }
      at += entry.size;
    }
    return absl::OkStatus();
  }

  // Writes the entries of blocks.
  absl::Status AddRun(const std::vector<BlockIndexEntry>& run, absl::string_view spans,
                      const io::RandomAccessFile& index) {
    for (std::size_t i = 0; i < run.size(); ++i) {
      BlockIndexEntry entry = run[i];
      const std::uint64_t key = BlockOrderKey(layout_, entry.block_id);
      if (summary_.block_count > 0 && key <= last_key_) {
        return absl::DataLossError(absl::StrCat(index.path(), ": block ", entry.block_id,
                                                " is not behind those of the parts before"));
      }
      last_key_ = key;
      JoinedBlock block{.id = entry.block_id,
                        .ordinal = static_cast<std::uint32_t>(summary_.block_count),
                        .span = {}};
      block.span.min = base::LoadLittleEndian<double>(spans.data() + i * kSpanBytes);
      block.span.max =
          base::LoadLittleEndian<double>(spans.data() + i * kSpanBytes + sizeof(double));
      ISOSCOPE_RETURN_IF_ERROR(visit_(block));
      entry.offset = summary_.block_bytes;
      const std::string bytes = EncodeBlockIndexEntry(entry);
      ISOSCOPE_RETURN_IF_ERROR(index_file_->Append(bytes));
      entries_crc32c_ = base::ExtendCrc32c(entries_crc32c_, bytes.data(), bytes.size());
      summary_.block_bytes += entry.size;
      ++summary_.block_count;
    }
    return absl::OkStatus();
  }

  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  const bool is_index_only_;
  const absl::FunctionRef<absl::Status(const JoinedBlock&)> visit_;
  const base::Cancellation& cancellation_;
  std::string directory_;
  std::unique_ptr<io::WritableFile> blocks_file_;  // null if it is index-only
  std::unique_ptr<io::WritableFile> index_file_;
  std::string buffer_;
  std::uint64_t last_key_ = 0;
  std::uint32_t entries_crc32c_ = 0;
  ShardSummary summary_;
};

}  // namespace

absl::StatusOr<ShardSummary> JoinShard(const std::vector<PieceOfShard>& pieces,
                                       const volume::BlockLayout& layout, volume::ScalarType type,
                                       const std::string& directory, bool is_direct,
                                       bool is_index_only,
                                       absl::FunctionRef<absl::Status(const JoinedBlock&)> visit,
                                       const base::Cancellation& cancellation) {
  Joiner joiner(layout, type, is_index_only, visit, cancellation);
  ISOSCOPE_RETURN_IF_ERROR(joiner.Create(directory, is_direct));
  for (const PieceOfShard& piece : pieces) {
    ISOSCOPE_RETURN_IF_ERROR(joiner.Add(piece));
  }
  return joiner.Finish();
}

}  // namespace isoscope::store
