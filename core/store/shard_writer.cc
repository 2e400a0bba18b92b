#include "core/store/shard_writer.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <openssl/evp.h>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/store/json_fields.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"
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

// Size and checksums of the interval tree, for shard.json.
struct TreeFile {
  std::int64_t size = 0;
  std::uint32_t crc32c = 0;
  std::uint32_t head_crc32c = 0;  // of the first kIntervalTreeHeadBytes
};

absl::StatusOr<TreeFile> SumUpTreeFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, base::OpenRandomAccessFile(path));
  TreeFile tree{.size = file->size_bytes()};
  std::string buffer(static_cast<std::size_t>(base::kMiB), '\0');
  for (std::int64_t offset = 0; offset < tree.size;) {
    const auto size = static_cast<std::size_t>(
        std::min(tree.size - offset, static_cast<std::int64_t>(buffer.size())));
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(offset, size, buffer.data()));
    tree.crc32c = base::ExtendCrc32c(tree.crc32c, buffer.data(), size);
    if (offset == 0) {
      tree.head_crc32c =
          base::Crc32c(absl::string_view(buffer.data(), size)
                           .substr(0, static_cast<std::size_t>(kIntervalTreeHeadBytes)));
    }
    offset += static_cast<std::int64_t>(size);
  }
  return tree;
}

std::string EncodeShardFile(const Manifest& manifest, std::uint32_t manifest_crc32c,
                            int shard_index, const TreeFile& tree) {
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
  return SealJson(DumpJson(json));
}

}  // namespace

absl::StatusOr<std::unique_ptr<ShardWriter>> ShardWriter::Create(
    const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
    std::vector<volume::BlockId> blocks, CreateFile create_file) {
  auto writer = std::unique_ptr<ShardWriter>(new ShardWriter);
  writer->entries_.reserve(blocks.size());
  for (std::size_t ordinal = 0; ordinal < blocks.size(); ++ordinal) {
    const volume::BlockId id = blocks[ordinal];
    if (id >= layout.block_count() ||
        (ordinal > 0 && BlockOrderKey(layout, blocks[ordinal - 1]) >= BlockOrderKey(layout, id))) {
      return absl::InvalidArgumentError(
          absl::StrFormat("shard %s: block %d at ordinal %d: expected ids below %d in Morton order",
                          directory, id, ordinal, layout.block_count()));
    }
    const auto size = static_cast<std::uint32_t>(volume::StoredSizeBytes(layout, id, type));
    writer->entries_.push_back({.offset = writer->block_bytes_, .size = size});
    writer->block_bytes_ += size;
  }
  writer->directory_ = directory;
  writer->create_file_ = std::move(create_file);
  writer->type_ = type;
  writer->blocks_ = std::move(blocks);
  ISOSCOPE_RETURN_IF_ERROR(base::CreateDirectory(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(writer->blocks_file_,
                            writer->create_file_(absl::StrCat(directory, "/", kBlocksFileName)));
  return writer;
}

absl::Status ShardWriter::WriteBlock(std::uint32_t ordinal, absl::string_view samples) {
  if (ordinal >= entries_.size()) {
    return absl::InvalidArgumentError(absl::StrFormat("shard %s: block ordinal %d, expected < %d",
                                                      directory_, ordinal, entries_.size()));
  }
  Entry& entry = entries_[ordinal];
  if (samples.size() != entry.size) {
    return absl::InvalidArgumentError(
        absl::StrFormat("shard %s: block %d has %d bytes, expected %d", directory_,
                        blocks_[ordinal], samples.size(), entry.size));
  }
  if (entry.is_written) {
    return absl::InternalError(
        absl::StrFormat("shard %s: block %d is written twice", directory_, blocks_[ordinal]));
  }
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->WriteAt(entry.offset, samples));
  entry.crc32c = base::Crc32c(samples);
  entry.is_written = true;
  return absl::OkStatus();
}

absl::StatusOr<ShardSummary> ShardWriter::FinishBlocks() {
  std::string payload;
  payload.reserve(entries_.size() * kBlockIndexEntryBytes);
  for (std::size_t ordinal = 0; ordinal < entries_.size(); ++ordinal) {
    const Entry& entry = entries_[ordinal];
    if (!entry.is_written) {
      return absl::InternalError(
          absl::StrFormat("shard %s: block %d was never written", directory_, blocks_[ordinal]));
    }
    base::AppendLittleEndian(blocks_[ordinal], &payload);
    base::AppendLittleEndian(static_cast<std::uint32_t>(BlockEncoding::kRaw), &payload);
    base::AppendLittleEndian(entry.offset, &payload);
    base::AppendLittleEndian(entry.size, &payload);  // stored
    base::AppendLittleEndian(entry.size, &payload);  // raw
    base::AppendLittleEndian(entry.crc32c, &payload);
    base::AppendLittleEndian(std::uint32_t{0}, &payload);
  }
  ISOSCOPE_RETURN_IF_ERROR(blocks_file_->Close());

  const std::string header =
      EncodeBinaryHeader(kBlockIndexMagic, {.scalar_type = static_cast<std::uint32_t>(type_),
                                            .entry_size = kBlockIndexEntryBytes,
                                            .count = static_cast<std::int64_t>(entries_.size()),
                                            .payload_crc32c = base::Crc32c(payload),
                                            .data_size = block_bytes_});
  ISOSCOPE_ASSIGN_OR_RETURN(const auto index_file,
                            create_file_(absl::StrCat(directory_, "/", kBlockIndexFileName)));
  ISOSCOPE_RETURN_IF_ERROR(index_file->Append(header));
  ISOSCOPE_RETURN_IF_ERROR(index_file->Append(payload));
  ISOSCOPE_RETURN_IF_ERROR(index_file->Close());
  return ShardSummary{.block_count = static_cast<std::int64_t>(entries_.size()),
                      .block_bytes = block_bytes_,
                      .block_index_crc32c =
                          base::ExtendCrc32c(base::Crc32c(header), payload.data(), payload.size())};
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
    order.push_back(BlockOrderKey(layout, static_cast<volume::BlockId>(block)));
    ++block_counts[shard_of_block[block]];
  }
  std::sort(order.begin(), order.end());
  std::vector<std::vector<volume::BlockId>> blocks(block_counts.size());
  for (std::size_t shard = 0; shard < blocks.size(); ++shard) {
    blocks[shard].reserve(block_counts[shard]);
  }
  for (const auto& [code, id] : order) {
    blocks[shard_of_block[id]].push_back(id);
  }
  return blocks;
}

std::string ComputeDatasetId(const Manifest& manifest) {
  // Strings carry their length and every number has a fixed width, so that no two manifests give
  // the same bytes.
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
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int digest_size = 0;
  ISOSCOPE_CHECK_EQ(EVP_Digest(canonical.data(), canonical.size(), digest.data(), &digest_size,
                               EVP_sha256(), nullptr),
                    1);
  constexpr std::size_t kIdBytes = 16;
  ISOSCOPE_CHECK_GE(digest_size, kIdBytes);
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(digest.data()), kIdBytes));
}

std::string EncodeRangeTable(const volume::RangeTable& ranges) {
  return EncodeBinaryHeader(
             kRangeTableMagic,
             {.scalar_type = static_cast<std::uint32_t>(ranges.type()),
              .entry_size = static_cast<std::uint32_t>(2 * volume::SizeOf(ranges.type())),
              .count = ranges.block_count(),
              .payload_crc32c = base::Crc32c(ranges.bytes())}) +
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

absl::Status WriteDescriptions(const std::string& directory, const Manifest& manifest,
                               absl::string_view range_table_bytes, int shard_index) {
  const std::string prefix = directory + "/";
  const std::string manifest_path = prefix + kManifestFileName;
  if (base::PathExists(manifest_path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(manifest_path, ": exists, expected a directory without a manifest"));
  }
  const std::string manifest_bytes = EncodeManifest(manifest);
  ISOSCOPE_RETURN_IF_ERROR(base::WriteWholeFile(prefix + kRangeTableFileName, range_table_bytes));
  if (shard_index >= 0) {
    ISOSCOPE_CHECK_LT(static_cast<std::size_t>(shard_index), manifest.shards.size());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t manifest_crc32c,
                              VerifySeal(manifest_bytes, manifest_path));
    ISOSCOPE_ASSIGN_OR_RETURN(const TreeFile tree, SumUpTreeFile(prefix + kIntervalTreeFileName));
    ISOSCOPE_RETURN_IF_ERROR(base::WriteWholeFile(
        prefix + kShardFileName, EncodeShardFile(manifest, manifest_crc32c, shard_index, tree)));
  }
  // Everything else is on disk before the manifest appears, and it appears whole.
  ISOSCOPE_RETURN_IF_ERROR(base::SyncDirectory(directory));
  const std::string partial_path = manifest_path + ".partial";
  ISOSCOPE_RETURN_IF_ERROR(base::WriteWholeFile(partial_path, manifest_bytes));
  return base::RenamePath(partial_path, manifest_path);
}

}  // namespace isoscope::store
