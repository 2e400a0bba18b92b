// A small shard on disk, for the tests of this folder.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_STORE_SHARD_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_STORE_SHARD_FIXTURE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/range_table.h"

namespace isoscope::store {

// The bytes of a block: noise that depends on the id.
inline std::string SamplesOf(const volume::BlockLayout& layout, volume::BlockId id,
                             volume::ScalarType type) {
  std::string bytes(volume::StoredSizeBytes(layout, id, type), '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(id, i) & 0x3f);
  }
  return bytes;
}

// Writes the blocks and the index of a shard, whose `ids` come in their order, into the new
// directory `path`.
inline absl::StatusOr<ShardSummary> WriteBlocks(
    const std::string& path, const volume::BlockLayout& layout, volume::ScalarType type,
    const std::vector<volume::BlockId>& ids,
    const ShardWriter::CreateFile& create_file = io::CreateWritableFile) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto writer,
                            ShardWriter::Create(path, layout, type, create_file));
  std::int64_t offset = 0;
  for (const volume::BlockId id : ids) {
    offset += static_cast<std::int64_t>(volume::StoredSizeBytes(layout, id, type));
  }
  // From the last to the first: the order of writing must not matter.
  std::vector<std::uint32_t> crcs(ids.size());
  for (std::size_t ordinal = ids.size(); ordinal-- > 0;) {
    const std::string samples = SamplesOf(layout, ids[ordinal], type);
    offset -= static_cast<std::int64_t>(samples.size());
    ISOSCOPE_ASSIGN_OR_RETURN(crcs[ordinal], writer->WriteBlock(ids[ordinal], offset, samples));
  }
  for (std::size_t ordinal = 0; ordinal < ids.size(); ++ordinal) {
    ISOSCOPE_RETURN_IF_ERROR(writer->AppendIndexEntry(ids[ordinal], crcs[ordinal]));
  }
  return writer->Finish();
}

// 7 x 6 x 5 samples in blocks of 3 x 2 x 4 cells: 2 x 3 x 1 blocks, smaller ones at the ends.
struct TestDataset {
  explicit TestDataset(volume::ScalarType scalar_type = volume::ScalarType::kUint8,
                       int shards = 1) {
    manifest.name = "tiny";
    manifest.source = "tiny.raw";
    manifest.geometry.sample_dims = {7, 6, 5};
    manifest.scalar_type = scalar_type;
    manifest.block_cells = {3, 2, 4};
    manifest.value_range = {.min = 0, .max = 60};
    manifest.seed = 7;
    layout = volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells).value();
    ranges = volume::RangeTable(scalar_type, layout.block_count());
    for (volume::BlockId id = 0; id + 1 < layout.block_count(); ++id) {
      ranges.Set(id, {.min = static_cast<double>(id), .max = static_cast<double>(10 * id + 10)});
    }
    shard_of_block.resize(static_cast<std::size_t>(layout.block_count()));
    for (std::size_t id = 0; id < shard_of_block.size(); ++id) {
      shard_of_block[id] = static_cast<std::uint16_t>(id % static_cast<std::size_t>(shards));
    }
    blocks = BlocksByShard(layout, shard_of_block, shards);
  }

  // Writes the dataset into the new directory `directory`.
  absl::Status Write(const std::string& directory) {
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(directory));
    manifest.shards.clear();
    const auto shard_count = static_cast<int>(blocks.size());
    for (int shard = 0; shard < shard_count; ++shard) {
      const auto& ids = blocks[static_cast<std::size_t>(shard)];
      const std::string path = directory + "/" + ShardDirectoryName(shard, shard_count);
      ISOSCOPE_ASSIGN_OR_RETURN(const ShardSummary summary,
                                WriteBlocks(path, layout, manifest.scalar_type, ids));
      manifest.shards.push_back(summary);
      ISOSCOPE_RETURN_IF_ERROR(
          io::WriteWholeFile(path + "/" + kIntervalTreeFileName, "stands for an interval tree"));
    }
    const std::string range_bytes = EncodeRangeTable(ranges);
    manifest.range_table_crc32c = base::Crc32c(range_bytes);
    manifest.dataset_id = ComputeDatasetId(manifest);
    for (int shard = 0; shard < shard_count; ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(WriteDescriptions(
          directory + "/" + ShardDirectoryName(shard, shard_count), manifest, range_bytes, shard));
    }
    return WriteDescriptions(directory, manifest, range_bytes, -1);
  }

  Manifest manifest;
  volume::BlockLayout layout;
  volume::RangeTable ranges;
  std::vector<std::uint16_t> shard_of_block;
  std::vector<std::vector<volume::BlockId>> blocks;
};

// Opens a shard and reads all of it: the ids and bytes of its blocks in order.
inline absl::StatusOr<std::vector<std::pair<volume::BlockId, std::string>>> ReadShard(
    const std::string& directory,
    const ShardReader::OpenFile& open_file = io::OpenRandomAccessFile) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto reader, ShardReader::Open(directory, open_file));
  std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader->block_count()));
  for (std::size_t i = 0; i < ordinals.size(); ++i) {
    ordinals[i] = static_cast<std::uint32_t>(i);
  }
  std::vector<std::pair<volume::BlockId, std::string>> blocks;
  for (const ShardReader::DiskRun& run : reader->PlanDiskRuns(ordinals)) {
    // A buffer of exactly the run's size, so that a sanitizer sees writes beyond it.
    std::vector<char> buffer(static_cast<std::size_t>(run.size));
    ISOSCOPE_RETURN_IF_ERROR(
        reader->ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
          blocks.emplace_back(
              block.block_id,
              std::string(block.bytes,
                          volume::StoredSizeBytes(reader->layout(), block.block_id, block.type)));
          return absl::OkStatus();
        }));
  }
  return blocks;
}

}  // namespace isoscope::store

#endif  // ISOSCOPE_TESTS_UNIT_CORE_STORE_SHARD_FIXTURE_H_
