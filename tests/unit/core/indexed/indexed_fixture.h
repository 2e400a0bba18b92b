// Sources on disk, and datasets of them with and without their samples.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_

#include <filesystem>
#include <map>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "core/formats/open_request.h"
#include "core/indexed/sample_opener.h"
#include "core/indexed/source_request.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_series.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_samples.h"
#include "tests/support/chunk_writer.h"
#include "tests/support/volume_files.h"
#include "zlib.h"

namespace isoscope::testing {

// Writes samples [z][y][x] as a Zarr 2 array in chunks, compressed by zlib.
inline void WriteZarr(const std::string& path, const math::Index3& dims, const std::string& dtype,
                      std::size_t sample_bytes, const math::Index3& chunk,
                      const std::string& samples) {
  std::filesystem::create_directories(path);
  WriteFile(path + "/.zarray",
            absl::StrCat(R"({"zarr_format": 2, "shape": [)", dims.z, ", ", dims.y, ", ", dims.x,
                         R"(], "chunks": [)", chunk.z, ", ", chunk.y, ", ", chunk.x,
                         R"(], "dtype": ")", dtype, R"(", "order": "C", "fill_value": 0, )",
                         R"("filters": null, "compressor": {"id": "zlib", "level": 1}})"));
  const PlainArray array{
      .dims = {dims.z, dims.y, dims.x}, .element_size = sample_bytes, .bytes = samples};
  const auto objects = WriteChunks(
      array,
      {.chunk_dims = {chunk.z, chunk.y, chunk.x},
       .encode = [](const std::string& s) { return Deflate(s, 15); },
       .fill = std::string(sample_bytes, '\0')},
      [](const source::ChunkIndex& i) { return absl::StrCat(i[0], ".", i[1], ".", i[2]); });
  for (const auto& [key, bytes] : objects) {
    WriteFile(absl::StrCat(path, "/", key), bytes);
  }
}

// Partitions the only volume of a request.
inline absl::StatusOr<store::Manifest> Cut(const source::OpenRequest& request,
                                           partition::PartitionOptions options,
                                           bool is_index_only) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                            source::Open(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            series->Open(0, 0, 0));
  if (is_index_only) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.in_source.emplace().request,
                              indexed::EncodeSourceRequest(request));
  }
  return partition::Partition(*source, options, base::Cancellation());
}

inline std::string ShardPath(const std::string& directory, const store::Manifest& manifest,
                             std::size_t shard) {
  return absl::StrCat(
      directory, "/",
      store::ShardDirectoryName(static_cast<int>(shard), static_cast<int>(manifest.shards.size())));
}

// All blocks of a dataset, by id, and the shard of each.
struct StoredBlocks {
  std::map<volume::BlockId, std::string> samples{};
  std::map<volume::BlockId, std::size_t> shards{};
};
inline absl::StatusOr<StoredBlocks> ReadBlocks(const std::string& directory,
                                               const store::Manifest& manifest,
                                               const store::OpenSamples& open_samples = nullptr) {
  StoredBlocks blocks;
  for (std::size_t shard = 0; shard < manifest.shards.size(); ++shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(const auto reader,
                              store::ShardReader::Open(ShardPath(directory, manifest, shard),
                                                       io::OpenRandomAccessFile, open_samples));
    std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader->block_count()));
    std::iota(ordinals.begin(), ordinals.end(), std::uint32_t{0});
    for (const store::ShardReader::DiskRun& run : reader->PlanDiskRuns(ordinals)) {
      std::vector<char> buffer(static_cast<std::size_t>(run.size));
      ISOSCOPE_RETURN_IF_ERROR(
          reader->ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
            blocks.samples[block.block_id].assign(
                block.bytes, volume::StoredSizeBytes(reader->layout(), block.block_id, block.type));
            blocks.shards[block.block_id] = shard;
            return absl::OkStatus();
          }));
    }
  }
  return blocks;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_
