// Sources on disk, and datasets of them with and without their samples.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/cancellation.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/formats/open_request.h"
#include "core/indexed/sample_opener.h"
#include "core/indexed/source_request.h"
#include "core/partition/part_joiner.h"
#include "core/partition/part_writer.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_partitioner.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_samples.h"
#include "tests/support/chunk_writer.h"
#include "tests/support/draws.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/volume_files.h"
#include "zlib.h"

namespace isoscope::testing {

// Writes samples, C order, as a Zarr 2 array in chunks, compressed by zlib.
inline void WriteZarrArray(const std::string& path, const source::ChunkIndex& dims,
                           const std::string& dtype, std::size_t sample_bytes,
                           const source::ChunkIndex& chunk, const std::string& samples) {
  std::filesystem::create_directories(path);
  WriteFile(path + "/.zarray",
            absl::StrCat(R"({"zarr_format": 2, "shape": [)", absl::StrJoin(dims, ", "),
                         R"(], "chunks": [)", absl::StrJoin(chunk, ", "), R"(], "dtype": ")", dtype,
                         R"(", "order": "C", "fill_value": 0, )",
                         R"("filters": null, "compressor": {"id": "zlib", "level": 1}})"));
  const PlainArray array{.dims = dims, .element_size = sample_bytes, .bytes = samples};
  const auto objects =
      WriteChunks(array,
                  {.chunk_dims = chunk,
                   .encode = [](const std::string& s) { return Deflate(s, 15); },
                   .fill = std::string(sample_bytes, '\0')},
                  [](const source::ChunkIndex& i) { return absl::StrJoin(i, "."); });
  for (const auto& [key, bytes] : objects) {
    WriteFile(absl::StrCat(path, "/", key), bytes);
  }
}
// The same of samples [z][y][x].
inline void WriteZarr(const std::string& path, const math::Index3& dims, const std::string& dtype,
                      std::size_t sample_bytes, const math::Index3& chunk,
                      const std::string& samples) {
  WriteZarrArray(path, {dims.z, dims.y, dims.x}, dtype, sample_bytes, {chunk.z, chunk.y, chunk.x},
                 samples);
}

// Writes samples [z][y][x][component] as VTK ImageData, appended raw: plain, or in zlib blocks.
// block_bytes: 0: plain
inline void WriteVti(const std::string& path, const math::Index3& dims, const std::string& type,
                     std::int64_t components, std::size_t block_bytes, const std::string& samples) {
  const std::string extent = absl::StrCat("0 ", dims.x - 1, " 0 ", dims.y - 1, " 0 ", dims.z - 1);
  std::string data;
  if (block_bytes == 0) {
    base::AppendLittleEndian(static_cast<std::uint64_t>(samples.size()), &data);
    data += samples;
  } else {
    base::AppendLittleEndian(
        static_cast<std::uint64_t>((samples.size() + block_bytes - 1) / block_bytes), &data);
    base::AppendLittleEndian(static_cast<std::uint64_t>(block_bytes), &data);
    base::AppendLittleEndian(static_cast<std::uint64_t>(samples.size() % block_bytes), &data);
    std::string blocks;
    for (std::size_t at = 0; at < samples.size(); at += block_bytes) {
      const std::string block = Deflate(samples.substr(at, block_bytes), 15);
      base::AppendLittleEndian(static_cast<std::uint64_t>(block.size()), &data);
      blocks += block;
    }
    data += blocks;
  }
  WriteFile(
      path,
      absl::StrCat("<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt64\"",
                   block_bytes == 0 ? "" : " compressor=\"vtkZLibDataCompressor\"",
                   ">\n<ImageData WholeExtent=\"", extent,
                   "\" Origin=\"0 0 0\" Spacing=\"1 1 1\">\n<Piece Extent=\"", extent,
                   "\">\n<PointData>\n<DataArray Name=\"u\" type=\"", type,
                   "\" NumberOfComponents=\"", components,
                   "\" format=\"appended\" offset=\"0\"/>\n</PointData></Piece></ImageData>\n"
                   "<AppendedData encoding=\"raw\">\n_",
                   data, "\n</AppendedData>\n</VTKFile>\n"));
}

// Writes a series: of Zarr a group of two arrays with time steps, or one with steps and components, in
// chunks of any size on all axes; or a VTK file for each step; or an HDF5 dataset with steps and
// components.
inline source::OpenRequest WriteSeries(const std::string& path, Dice* dice) {
  const math::Index3 dims{dice->Whole(4, 40), dice->Whole(4, 30), dice->Whole(4, 40)};
  const std::int64_t steps = dice->Whole(2, 4);  // one alone may be no series
  const auto noise = [&](std::int64_t volumes, volume::ScalarType type) {
    return SampleNoise(dice->Bits(), {dims.x, dims.y, dims.z * volumes}, type, 100);
  };
  const auto chunk = [&](std::int64_t volumes) {
    return source::ChunkIndex{dice->Whole(1, volumes), dice->Whole(1, 40), dice->Whole(1, 40),
                              dice->Whole(1, 40)};
  };
  std::filesystem::create_directories(path);
  if (dice->OneIn(3)) {
    const std::int64_t components = dice->Whole(1, 3);
    for (std::int64_t step = 0; step < steps; ++step) {
      WriteVti(absl::StrCat(path, "/run_", step, ".vti"), dims, "UInt16", components,
               dice->OneIn(2) ? 0 : static_cast<std::size_t>(dice->Whole(1, 9000)),
               noise(components, volume::ScalarType::kUint16));
    }
    return {.path = path + "/run_*.vti"};
  }
  if (dice->OneIn(2)) {
    WriteFile(path + "/.zgroup", R"({"zarr_format": 2})");
    WriteZarrArray(path + "/p", {steps, dims.z, dims.y, dims.x}, "<u2", 2, chunk(steps),
                   noise(steps, volume::ScalarType::kUint16));
    WriteZarrArray(path + "/q", {steps, dims.z, dims.y, dims.x}, "<f4", 4, chunk(steps),
                   noise(steps, volume::ScalarType::kFloat32));
    return {.path = path, .axes = "TZYX"};
  }
  const std::int64_t components = dice->Whole(2, 3);
  if (dice->OneIn(2)) {
    const source::ChunkIndex all{steps, components, dims.z, dims.y, dims.x};
    std::vector<hsize_t> chunks;
    for (const std::int64_t size : all) {
      chunks.push_back(static_cast<hsize_t>(dice->Whole(1, std::min<std::int64_t>(size, 40))));
    }
    const std::string samples = noise(steps * components, volume::ScalarType::kUint16);
    const std::string file = path + "/s.h5";
    const std::string name = std::filesystem::path(path).stem();  // as that of the Zarr array
    const hid_t created = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    WriteHdf5Dataset(created, name, {all.begin(), all.end()}, H5T_STD_U16LE, samples.data(),
                     dice->OneIn(4) ? std::vector<hsize_t>() : chunks);
    H5Fclose(created);
    return {.path = file, .axes = "TCZYX"};
  }
  source::ChunkIndex chunks = chunk(steps);
  chunks.insert(chunks.begin() + 1, dice->Whole(1, components));
  WriteZarrArray(path, {steps, components, dims.z, dims.y, dims.x}, "<u2", 2, chunks,
                 noise(steps * components, volume::ScalarType::kUint16));
  return {.path = path, .axes = "TCZYX"};
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

// Partitions all volumes of a request as a series.
inline absl::StatusOr<store::SeriesManifest> CutSeries(const source::OpenRequest& request,
                                                       partition::PartitionOptions options,
                                                       bool is_index_only) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                            source::OpenIdentified(request));
  if (is_index_only) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.in_source.emplace().request,
                              indexed::EncodeSourceRequest(request));
  }
  return partition::PartitionSeries(*series, {.volume = options}, base::Cancellation());
}

// Cuts an index-only dataset in parts, and joins them.
inline absl::Status CutParts(const source::OpenRequest& request,
                             partition::PartitionOptions options, int count) {
  ISOSCOPE_ASSIGN_OR_RETURN(options.in_source.emplace().request,
                            indexed::EncodeSourceRequest(request));
  for (int index = count; index-- > 0;) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                              source::OpenIdentified(request));
    ISOSCOPE_RETURN_IF_ERROR(
        partition::PartitionPart(*series,
                                 {.volume = options,
                                  .part = {.index = index, .count = count},
                                  .source_members = {{"the source", request.path}}},
                                 base::Cancellation())
            .status());
  }
  return partition::JoinParts(options.output_directory, {}, base::Cancellation()).status();
}

// The bytes of all files of a folder, by their paths in it.
inline std::map<std::string, std::string> FilesOf(const std::string& directory) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(directory)) {
    if (entry.is_regular_file()) {
      files[std::filesystem::relative(entry.path(), directory)] = ReadFile(entry.path());
    }
  }
  return files;
}

// All blocks of a dataset, by id, and the shard of each.
struct StoredBlocks {
  std::map<volume::BlockId, std::string> samples{};
  std::map<volume::BlockId, std::size_t> shards{};
};
// Adds those of one shard.
inline absl::Status AddBlocks(const std::string& directory, std::size_t shard,
                              const store::OpenSamples& open_samples, StoredBlocks* blocks) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const auto reader,
      store::ShardReader::Open(directory, io::OpenRandomAccessFile, open_samples));
  std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader->block_count()));
  std::iota(ordinals.begin(), ordinals.end(), std::uint32_t{0});
  for (const store::ShardReader::DiskRun& run : reader->PlanDiskRuns(ordinals)) {
    std::vector<char> buffer(static_cast<std::size_t>(run.size));
    ISOSCOPE_RETURN_IF_ERROR(
        reader->ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
          blocks->samples[block.block_id].assign(
              block.bytes, volume::StoredSizeBytes(reader->layout(), block.block_id, block.type));
          blocks->shards[block.block_id] = shard;
          return absl::OkStatus();
        }));
  }
  return absl::OkStatus();
}
inline absl::StatusOr<StoredBlocks> ReadBlocks(const std::string& directory,
                                               const store::Manifest& manifest,
                                               const store::OpenSamples& open_samples = nullptr) {
  StoredBlocks blocks;
  for (std::size_t shard = 0; shard < manifest.shards.size(); ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(
        AddBlocks(ShardPath(directory, manifest, shard), shard, open_samples, &blocks));
  }
  return blocks;
}
// The same of a volume of a series.
inline absl::StatusOr<StoredBlocks> ReadBlocks(const std::string& directory,
                                               const store::SeriesManifest& series,
                                               const store::ScalarVolumeKey& key,
                                               const store::OpenSamples& open_samples = nullptr) {
  StoredBlocks blocks;
  for (int shard = 0; shard < series.shard_count; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(
        AddBlocks(absl::StrCat(directory, "/", store::ShardDirectoryName(shard, series.shard_count),
                               "/", store::ScalarVolumeDirectoryName(key)),
                  static_cast<std::size_t>(shard), open_samples, &blocks));
  }
  return blocks;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_INDEXED_INDEXED_FIXTURE_H_
