// A shard directory is written in this order:
//
//   ShardWriter::Create             the directory, and blocks.bin
//   ShardWriter::WriteBlock         samples at the offset that the caller gives, in any order
//   ShardWriter::AppendBlock        encoded blocks, whose sizes nobody knows before, one after the
//                                   other
//   ShardWriter::AppendIndexEntry   by ordinal; the first call closes blocks.bin and creates
//                                   block_index.bin with 64 zero bytes instead of a header. Blocks
//                                   that were appended in another order are copied to a new
//                                   blocks.bin
//   ShardWriter::Finish             the header of block_index.bin; the summary for the manifest
//   the caller                      interval_tree.bin, histogram.bin and ranges.bin
//   WriteDescriptions               shard.json, a sync of the directory, manifest.json.partial,
//                                   and its new name manifest.json
//
// Invariants: a file without its header was not finished, a directory without manifest.json was not
// either, and no reader opens them. Blocks lie without gaps: the offset of ordinal i is the sum of
// the sizes of the ordinals before it. The caller computes offsets before the entries exist, so
// Finish compares the number of blocks and the end of blocks.bin with the index.
//
// Example: two blocks of 12 bytes each lie at offsets 0 and 12 of blocks.bin; block_index.bin has
// 64 + 2 * 32 = 128 bytes (docs/format/shard.md lists them).
//
// Checksums form a tree whose root is the manifest: it holds the CRC-32C of ranges.bin and of each
// block_index.bin, which holds that of each block; shard.json holds that of the manifest beside it,
// of interval_tree.bin and of histogram.bin.
//
// Layouts: docs/format/shard.md, docs/format/dataset.md.

#include "core/store/shard_writer.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/store/block_order.h"
#include "core/store/json_fields.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"
#include "core/store/span_tree_file.h"
#include "core/volume/block_samples.h"

namespace isoscope::store {
namespace {

void AppendString(absl::string_view text, std::string* out) {
  base::AppendLittleEndian(static_cast<std::uint64_t>(text.size()), out);
  out->append(text.data(), text.size());
}

template <typename T>
void AppendVector(const math::Vec3<T>& vector, std::string* out) {
  base::AppendLittleEndian(vector.x, out);
  base::AppendLittleEndian(vector.y, out);
  base::AppendLittleEndian(vector.z, out);
}

// The size and the checksums of a file.
struct FileSums {
  std::int64_t size = 0;
  std::uint32_t crc32c = 0;
  std::uint32_t head_crc32c = 0;  // of the first kIntervalTreeHeadBytes
};

absl::StatusOr<FileSums> SumUpFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
  FileSums sums{.size = file->size_bytes()};
  std::string buffer(static_cast<std::size_t>(base::kMiB), '\0');
  for (std::int64_t offset = 0; offset < sums.size;) {
    const auto size = static_cast<std::size_t>(
        std::min(sums.size - offset, static_cast<std::int64_t>(buffer.size())));
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(offset, size, buffer.data()));
    sums.crc32c = base::ExtendCrc32c(sums.crc32c, buffer.data(), size);
    if (offset == 0) {
      sums.head_crc32c =
          base::Crc32c(absl::string_view(buffer.data(), size)
                           .substr(0, static_cast<std::size_t>(kIntervalTreeHeadBytes)));
    }
    offset += static_cast<std::int64_t>(size);
  }
  return sums;
}

std::string EncodeShardFile(const Manifest& manifest, std::uint32_t manifest_crc32c,
                            int shard_index, const FileSums& tree,
                            const std::optional<FileSums>& histogram) {
  const ShardSummary& shard = manifest.shards[static_cast<std::size_t>(shard_index)];
  Json json;
  json["format"] = std::string(kShardFormat);
  json["format_version"] = kFormatVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  json["dataset_id"] = manifest.dataset_id;
  json["shard_index"] = shard_index;
  json["shard_count"] = manifest.shards.size();
  json["manifest_crc32c"] = JsonFromCrc32c(manifest_crc32c);
  json["block_index_crc32c"] = JsonFromCrc32c(shard.block_index_crc32c);
  json["blocks_bytes"] = shard.block_bytes;
  json["interval_tree_bytes"] = tree.size;
  json["interval_tree_crc32c"] = JsonFromCrc32c(tree.crc32c);
  json["interval_tree_head_crc32c"] = JsonFromCrc32c(tree.head_crc32c);
  if (histogram.has_value()) {
    json["histogram_bytes"] = histogram->size;
    json["histogram_crc32c"] = JsonFromCrc32c(histogram->crc32c);
  }
  return SealJson(DumpJson(json));
}

std::string EncodeRangeTableHeader(volume::ScalarType type, std::int64_t block_count,
                                   std::uint32_t entries_crc32c) {
  return EncodeBinaryHeader(kRangeTableMagic,
                            {.scalar_type = static_cast<std::uint32_t>(type),
                             .entry_size = static_cast<std::uint32_t>(2 * volume::SizeOf(type)),
                             .count = block_count,
                             .payload_crc32c = entries_crc32c});
}

absl::Status CheckIsNotDescribed(const std::string& manifest_path) {
  if (io::PathExists(manifest_path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(manifest_path, ": exists, expected a directory without a manifest"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<ShardWriter>> ShardWriter::Create(const std::string& directory,
                                                                 const volume::BlockLayout& layout,
                                                                 volume::ScalarType type,
                                                                 CreateFile create_file) {
  auto writer = std::unique_ptr<ShardWriter>(new ShardWriter);
  writer->directory_ = directory;
  writer->create_file_ = std::move(create_file);
  writer->layout_ = layout;
  writer->type_ = type;
  ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(writer->blocks_file_,
                            writer->create_file_(absl::StrCat(directory, "/", kBlocksFileName)));
  return writer;
}

absl::StatusOr<std::uint32_t> ShardWriter::WriteBlock(volume::BlockId id, std::int64_t offset,
                                                      absl::string_view samples) {
  std::uint32_t crc32c = 0;
  ISOSCOPE_RETURN_IF_ERROR(WriteBlocks({&id, 1}, offset, samples, {&crc32c, 1}));
  return crc32c;
}

absl::Status ShardWriter::WriteBlocks(absl::Span<const volume::BlockId> ids, std::int64_t offset,
                                      absl::string_view samples, absl::Span<std::uint32_t> crcs) {
  ISOSCOPE_CHECK_EQ(ids.size(), crcs.size());
  std::size_t begin = 0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] >= layout_.block_count() || offset < 0) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "shard %s: block %d at offset %d, expected an id below %d and no negative offset",
          directory_, ids[i], offset, layout_.block_count()));
    }
    const std::size_t size = volume::StoredSizeBytes(layout_, ids[i], type_);
    const absl::string_view block = samples.substr(std::min(begin, samples.size()), size);
    begin += size;
    const bool is_last = i + 1 == ids.size();
    if (block.size() != size || (is_last && begin != samples.size())) {
      return absl::InvalidArgumentError(
          absl::StrFormat("shard %s: %d bytes up to block %d, the last of %d, expected %d",
                          directory_, samples.size(), ids[i], ids.size(), begin));
    }
    crcs[i] = base::Crc32c(block);
  }
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->WriteAt(offset, samples));
  written_block_count_ += static_cast<std::int64_t>(ids.size());
  return absl::OkStatus();
}

absl::StatusOr<std::int64_t> ShardWriter::AppendBlock(volume::BlockId id,
                                                      absl::string_view stored) {
  if (id >= layout_.block_count()) {
    return absl::InvalidArgumentError(absl::StrFormat("shard %s: block %d, expected an id below %d",
                                                      directory_, id, layout_.block_count()));
  }
  const std::uint64_t key = BlockOrderKey(layout_, id);
  is_ordered_ = is_ordered_ && (written_block_count_ == 0 || last_key_ < key);
  last_key_ = key;
  const std::int64_t offset = blocks_file_->size_bytes();
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Append(stored));
  ++written_block_count_;
  return offset;
}

absl::Status ShardWriter::AppendIndexEntry(volume::BlockId id, std::uint32_t crc32c) {
  BlockIndexEntry entry{.block_id = id, .offset = block_bytes_, .crc32c = crc32c};
  if (id < layout_.block_count()) {
    entry.size = static_cast<std::uint32_t>(volume::StoredSizeBytes(layout_, id, type_));
  }
  return AppendIndexEntry(entry);
}

absl::Status ShardWriter::AppendIndexEntry(BlockIndexEntry entry) {
  if (entry.block_id >= layout_.block_count() ||
      (block_count_ > 0 &&
       BlockOrderKey(layout_, last_id_) >= BlockOrderKey(layout_, entry.block_id))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "shard %s: block %d at ordinal %d: expected ids below %d in the order of blocks",
        directory_, entry.block_id, block_count_, layout_.block_count()));
  }
  if (index_file_ == nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(StartIndex());
  }
  if (unordered_file_ != nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(CopyBlock(entry));
  }
  entry.offset = block_bytes_;
  entry.raw_size =
      static_cast<std::uint32_t>(volume::StoredSizeBytes(layout_, entry.block_id, type_));
  const std::string bytes = EncodeBlockIndexEntry(entry);
  ISOSCOPE_RETURN_IF_ERROR(index_file_->Append(bytes));
  entries_crc32c_ = base::ExtendCrc32c(entries_crc32c_, bytes.data(), bytes.size());
  last_id_ = entry.block_id;
  block_bytes_ += entry.size;
  ++block_count_;
  return absl::OkStatus();
}

absl::Status ShardWriter::StartIndex() {
  // Closed here, not in Finish: with many shards, a second buffer for each would be too much.
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Close());
  if (!is_ordered_) {
    // The file without a name goes when it is closed, whatever happens.
    const std::string path = absl::StrCat(directory_, "/", kBlocksFileName);
    ISOSCOPE_ASSIGN_OR_RETURN(unordered_file_, io::OpenRandomAccessFile(path));
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
    ISOSCOPE_ASSIGN_OR_RETURN(blocks_file_, create_file_(path));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(index_file_,
                            create_file_(absl::StrCat(directory_, "/", kBlockIndexFileName)));
  return index_file_->Append(std::string(kBinaryHeaderBytes, '\0'));
}

absl::Status ShardWriter::CopyBlock(const BlockIndexEntry& entry) {
  block_.resize(entry.size);
  ISOSCOPE_RETURN_IF_ERROR(unordered_file_->ReadAt(entry.offset, block_.size(), block_.data()));
  return blocks_file_->Append(block_);
}

absl::StatusOr<ShardSummary> ShardWriter::Finish() {
  if (block_count_ == 0 || block_count_ != written_block_count_ ||
      block_bytes_ != blocks_file_->size_bytes()) {
    return absl::InternalError(absl::StrFormat(
        "shard %s: %d blocks up to offset %d were written, expected the %d blocks of %d bytes of "
        "the index, at least one",
        directory_, written_block_count_, blocks_file_->size_bytes(), block_count_, block_bytes_));
  }
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Close());
  unordered_file_.reset();
  ISOSCOPE_RETURN_IF_ERROR(index_file_->WriteAt(
      0, EncodeBinaryHeader(kBlockIndexMagic, {.scalar_type = static_cast<std::uint32_t>(type_),
                                               .entry_size = kBlockIndexEntryBytes,
                                               .count = block_count_,
                                               .payload_crc32c = entries_crc32c_,
                                               .data_size = block_bytes_})));
  ISOSCOPE_RETURN_IF_ERROR(index_file_->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(const FileSums index,
                            SumUpFile(absl::StrCat(directory_, "/", kBlockIndexFileName)));
  return ShardSummary{
      .block_count = block_count_, .block_bytes = block_bytes_, .block_index_crc32c = index.crc32c};
}

std::vector<std::vector<volume::BlockId>> BlocksByShard(
    const volume::BlockLayout& layout, const std::vector<std::uint16_t>& shard_of_block,
    int shard_count) {
  ISOSCOPE_CHECK_EQ(static_cast<std::int64_t>(shard_of_block.size()), layout.block_count());
  std::vector<std::pair<std::uint64_t, volume::BlockId>> order;
  order.reserve(shard_of_block.size());
  std::vector<std::size_t> block_counts(static_cast<std::size_t>(shard_count));
  for (std::size_t block = 0; block < shard_of_block.size(); ++block) {
    ISOSCOPE_CHECK_LT(static_cast<int>(shard_of_block[block]), shard_count);
    const auto id = static_cast<volume::BlockId>(block);
    order.emplace_back(BlockOrderKey(layout, id), id);
    ++block_counts[shard_of_block[block]];
  }
  std::sort(order.begin(), order.end());
  std::vector<std::vector<volume::BlockId>> blocks(block_counts.size());
  for (std::size_t shard = 0; shard < blocks.size(); ++shard) {
    blocks[shard].reserve(block_counts[shard]);
  }
  for (const auto& [key, id] : order) {
    blocks[shard_of_block[id]].push_back(id);
  }
  return blocks;
}

std::string ComputeDatasetId(const Manifest& manifest) {
  // Strings carry their length and all other fields have a fixed width, so different manifests give
  // different bytes.
  std::string canonical;
  AppendString("isoscope dataset 1", &canonical);
  AppendString(manifest.source, &canonical);
  AppendVector(manifest.geometry.sample_dims, &canonical);
  AppendVector(manifest.geometry.spacing, &canonical);
  AppendVector(manifest.geometry.origin, &canonical);
  for (const math::Vec3d& column : manifest.geometry.direction.columns) {
    AppendVector(column, &canonical);
  }
  AppendString(volume::NameOf(manifest.scalar_type), &canonical);
  base::AppendLittleEndian(manifest.value_range.min, &canonical);
  base::AppendLittleEndian(manifest.value_range.max, &canonical);
  AppendVector(manifest.block_cells, &canonical);
  AppendString(NameOf(manifest.distribution), &canonical);
  base::AppendLittleEndian(manifest.seed, &canonical);
  base::AppendLittleEndian(manifest.range_table_crc32c, &canonical);
  base::AppendLittleEndian(static_cast<std::uint64_t>(manifest.shards.size()), &canonical);
  for (const ShardSummary& shard : manifest.shards) {
    base::AppendLittleEndian(shard.block_count, &canonical);
    base::AppendLittleEndian(shard.block_bytes, &canonical);
    base::AppendLittleEndian(shard.block_index_crc32c, &canonical);
  }
  if (manifest.patient_frame.has_value()) {  // datasets without one keep their earlier ids
    AppendString("patient_frame", &canonical);
    AppendString(manifest.patient_frame->name(), &canonical);
  }
  for (const volume::Label& label : manifest.labels) {  // as above
    AppendString("label", &canonical);
    base::AppendLittleEndian(label.value, &canonical);
    AppendString(label.name, &canonical);
    AppendString(label.color.has_value() ? volume::ToHex(*label.color) : "", &canonical);
  }
  if (manifest.in_source.has_value()) {
    AppendString("in_source", &canonical);
    for (const auto& [name, value] : manifest.in_source->request) {
      AppendString(name, &canonical);
      AppendString(value, &canonical);
    }
    AppendVector(manifest.in_source->unit_origin, &canonical);
    AppendVector(manifest.in_source->unit_dims, &canonical);
  }
  constexpr std::size_t kIdDigits = 32;
  return base::Sha256Hex(canonical).substr(0, kIdDigits);
}

std::string EncodeRangeTable(const volume::RangeTable& ranges) {
  return EncodeRangeTableHeader(ranges.type(), ranges.block_count(), base::Crc32c(ranges.bytes())) +
         ranges.bytes();
}

absl::StatusOr<volume::RangeTable> DecodeRangeTable(absl::string_view bytes,
                                                    absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const BinaryHeader header,
                            DecodeBinaryFile(kRangeTableMagic, bytes, where));
  if (header.scalar_type < static_cast<std::uint32_t>(volume::ScalarType::kUint8) ||
      header.scalar_type > static_cast<std::uint32_t>(volume::ScalarType::kFloat64)) {
    return absl::DataLossError(absl::StrFormat("%s: offset 16: sample type %d, expected 1 to 8",
                                               where, header.scalar_type));
  }
  const auto type = static_cast<volume::ScalarType>(header.scalar_type);
  if (header.entry_size != 2 * volume::SizeOf(type)) {
    return absl::DataLossError(absl::StrFormat("%s: offset 20: entries of %d bytes, expected %d",
                                               where, header.entry_size, 2 * volume::SizeOf(type)));
  }
  return volume::RangeTable::FromBytes(type, header.count,
                                       std::string(bytes.substr(kBinaryHeaderBytes)));
}

absl::StatusOr<std::unique_ptr<RangeTableWriter>> RangeTableWriter::Create(
    const std::string& path, volume::ScalarType type) {
  auto writer = std::unique_ptr<RangeTableWriter>(new RangeTableWriter);
  writer->path_ = path;
  writer->type_ = type;
  ISOSCOPE_ASSIGN_OR_RETURN(writer->file_, io::CreateWritableFile(path));
  ISOSCOPE_RETURN_IF_ERROR(writer->file_->Append(std::string(kBinaryHeaderBytes, '\0')));
  return writer;
}

absl::Status RangeTableWriter::Append(const volume::RangeTable& ranges) {
  ISOSCOPE_CHECK(ranges.type() == type_);
  entries_crc32c_ =
      base::ExtendCrc32c(entries_crc32c_, ranges.bytes().data(), ranges.bytes().size());
  block_count_ += ranges.block_count();
  return file_->Append(ranges.bytes());
}

absl::StatusOr<std::uint32_t> RangeTableWriter::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(
      file_->WriteAt(0, EncodeRangeTableHeader(type_, block_count_, entries_crc32c_)));
  ISOSCOPE_RETURN_IF_ERROR(file_->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(const FileSums sums, SumUpFile(path_));
  return sums.crc32c;
}

absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               int shard_index) {
  const std::string prefix = directory + "/";
  const std::string manifest_path = prefix + kManifestFileName;
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNotDescribed(manifest_path));
  if (!io::PathExists(prefix + kRangeTableFileName)) {
    return absl::NotFoundError(absl::StrCat(prefix, kRangeTableFileName,
                                            ": does not exist, expected before the manifest"));
  }
  const std::string manifest_bytes = EncodeManifest(manifest);
  if (shard_index >= 0) {
    ISOSCOPE_CHECK_LT(static_cast<std::size_t>(shard_index), manifest.shards.size());
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::BlockLayout layout,
        volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
    if (NeedsSpanTree(manifest, layout)) {
      ISOSCOPE_RETURN_IF_ERROR(WriteSpanTree(directory, manifest, layout));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t manifest_crc32c,
                              ManifestCrc32c(manifest_bytes, manifest_path));
    ISOSCOPE_ASSIGN_OR_RETURN(const FileSums tree, SumUpFile(prefix + kIntervalTreeFileName));
    std::optional<FileSums> histogram;
    if (io::PathExists(prefix + kHistogramFileName)) {
      ISOSCOPE_ASSIGN_OR_RETURN(histogram, SumUpFile(prefix + kHistogramFileName));
    }
    ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(
        prefix + kShardFileName,
        EncodeShardFile(manifest, manifest_crc32c, shard_index, tree, histogram)));
  }
  // Everything else reaches the disk before the manifest appears, and the manifest appears whole.
  ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(directory));
  const std::string partial_path = manifest_path + ".partial";
  ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(partial_path, manifest_bytes));
  return io::RenamePath(partial_path, manifest_path);
}

absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index) {
  const std::string prefix = directory + "/";
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNotDescribed(prefix + kManifestFileName));
  ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(prefix + kRangeTableFileName, range_table_bytes));
  return WriteDescriptions(directory, manifest, shard_index);
}

}  // namespace isoscope::store
