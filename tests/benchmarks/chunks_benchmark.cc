// Reading a volume out of shards, and what decoding its chunks takes alone.
//
// The volume has side^3 samples of uint16: a smooth field with noise in its lowest bits. It is
// written into a folder as Zarr 3: shards of 256^3, in them chunks of 64^3, zstd at level 3. All
// benchmarks run on all threads of TBB:
//
//   Decode   ZSTD_decompress of every chunk from memory, each into one buffer of its thread
//   Load     the bytes of all shards from the page cache, into one buffer of its thread
//   Read     layer after layer of chunks by the reader, which the operating system's cache serves
//
// Times are those of the clock, and of all threads' processors, which count where other programs
// run. 1024^3 takes 2.5 GB of the temporary folder and of memory:
//   chunks_benchmark --benchmark_filter=side:1024 --benchmark_repetitions=7
//       --benchmark_enable_random_interleaving=true

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "benchmark/benchmark.h"
#include "oneapi/tbb/enumerable_thread_specific.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/formats/zarr/zarr_series.h"
#include "zstd.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kChunkSide = 64;
constexpr std::int64_t kChunkBytes = kChunkSide * kChunkSide * kChunkSide * 2;

std::string EncodedChunk(std::int64_t side, std::int64_t z0, std::int64_t y0, std::int64_t x0) {
  std::string samples(static_cast<std::size_t>(kChunkBytes), '\0');
  const double step = 12.0 / static_cast<double>(side);
  std::uint64_t noise = static_cast<std::uint64_t>((z0 * side + y0) * side + x0) * 2 + 1;
  std::vector<double> along_x(kChunkSide);
  for (std::int64_t x = 0; x < kChunkSide; ++x) {
    along_x[static_cast<std::size_t>(x)] = std::sin(step * static_cast<double>(x0 + x));
  }
  char* out = samples.data();
  for (std::int64_t z = 0; z < kChunkSide; ++z) {
    const double at_z = std::cos(step * static_cast<double>(z0 + z));
    for (std::int64_t y = 0; y < kChunkSide; ++y) {
      const double at_y = std::sin(step * static_cast<double>(y0 + y)) + at_z;
      for (std::int64_t x = 0; x < kChunkSide; ++x) {
        noise = noise * 6364136223846793005U + 1442695040888963407U;
        const double value = 1000 * (3 + at_y + along_x[static_cast<std::size_t>(x)]);
        base::StoreLittleEndian(
            static_cast<std::uint16_t>(static_cast<std::uint64_t>(value) + (noise >> 60)), out);
        out += 2;
      }
    }
  }
  std::string encoded(ZSTD_compressBound(samples.size()), '\0');
  encoded.resize(ZSTD_compress(encoded.data(), encoded.size(), samples.data(), samples.size(), 3));
  return encoded;
}

// A store, and its chunks in memory.
struct ShardedVolume {
  std::string folder;
  std::vector<std::string> shards;
  std::vector<std::string> chunks;
};

std::string WriteShard(std::int64_t side, std::int64_t shard_side, std::int64_t z, std::int64_t y,
                       std::int64_t x, std::vector<std::string>* chunks) {
  const std::int64_t count = shard_side / kChunkSide;
  chunks->resize(static_cast<std::size_t>(count * count * count));
  tbb::parallel_for(std::int64_t{0}, count * count * count, [&](std::int64_t i) {
    (*chunks)[static_cast<std::size_t>(i)] = EncodedChunk(
        side, z * shard_side + i / (count * count) * kChunkSide,
        y * shard_side + i / count % count * kChunkSide, x * shard_side + i % count * kChunkSide);
  });
  std::string shard;
  std::string index;
  for (const std::string& chunk : *chunks) {
    base::AppendLittleEndian(static_cast<std::uint64_t>(shard.size()), &index);
    base::AppendLittleEndian(static_cast<std::uint64_t>(chunk.size()), &index);
    shard += chunk;
  }
  base::AppendLittleEndian(base::Crc32c(index), &index);
  return shard + index;
}

std::unique_ptr<ShardedVolume> WriteVolume(std::int64_t side) {
  auto volume = std::make_unique<ShardedVolume>();
  volume->folder = absl::StrCat(std::filesystem::temp_directory_path().string(),
                                "/isoscope_chunks_benchmark_", side, ".zarr");
  const std::int64_t shard_side = std::min<std::int64_t>(side, 256);
  std::filesystem::create_directories(volume->folder);
  const std::string dims = absl::StrCat("[", side, ",", side, ",", side, "]");
  const std::string shard_dims =
      absl::StrCat("[", shard_side, ",", shard_side, ",", shard_side, "]");
  std::ofstream(absl::StrCat(volume->folder, "/zarr.json")) << absl::StrCat(
      R"({"zarr_format": 3, "node_type": "array", "data_type": "uint16", "fill_value": 0, "shape": )",
      dims, R"(, "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": )", shard_dims,
      R"(}}, "chunk_key_encoding": {"name": "default"}, "codecs": [{"name": "sharding_indexed",
      "configuration": {"chunk_shape": [64, 64, 64], "codecs": [{"name": "bytes", "configuration":
      {"endian": "little"}}, {"name": "zstd", "configuration": {"level": 3, "checksum": false}}],
      "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}},
      {"name": "crc32c"}], "index_location": "end"}}]})");
  const std::int64_t count = side / shard_side;
  for (std::int64_t i = 0; i < count * count * count; ++i) {
    std::vector<std::string> chunks;
    const std::int64_t z = i / (count * count);
    const std::int64_t y = i / count % count;
    const std::string shard = WriteShard(side, shard_side, z, y, i % count, &chunks);
    const std::string folder = absl::StrCat(volume->folder, "/c/", z, "/", y);
    std::filesystem::create_directories(folder);
    volume->shards.push_back(absl::StrCat(folder, "/", i % count));
    std::ofstream(volume->shards.back(), std::ios::binary) << shard;
    volume->chunks.insert(volume->chunks.end(), chunks.begin(), chunks.end());
  }
  return volume;
}

const ShardedVolume& VolumeOf(std::int64_t side) {
  static auto& volumes = *new std::map<std::int64_t, std::unique_ptr<ShardedVolume>>();
  if (!volumes.contains(side)) {
    volumes[side] = WriteVolume(side);
    std::atexit([] {
      for (const auto& [written, volume] : volumes) {
        std::filesystem::remove_all(volume->folder);
      }
    });
  }
  return *volumes[side];
}

void SetBytes(benchmark::State& state) {
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * state.range(0) *
                          state.range(0) * state.range(0) * 2);
}

void BM_Decode(benchmark::State& state) {
  const ShardedVolume& volume = VolumeOf(state.range(0));
  tbb::enumerable_thread_specific<std::string> buffers(
      std::string(static_cast<std::size_t>(kChunkBytes), '\0'));
  for (auto _ : state) {
    tbb::parallel_for(std::size_t{0}, volume.chunks.size(), [&](std::size_t i) {
      std::string& out = buffers.local();
      const std::size_t size =
          ZSTD_decompress(out.data(), out.size(), volume.chunks[i].data(), volume.chunks[i].size());
      ISOSCOPE_CHECK_EQ(size, out.size());
    });
  }
  SetBytes(state);
}

void BM_Load(benchmark::State& state) {
  const ShardedVolume& volume = VolumeOf(state.range(0));
  tbb::enumerable_thread_specific<std::string> buffers(std::string(1 << 20, '\0'));
  for (auto _ : state) {
    tbb::parallel_for(std::size_t{0}, volume.shards.size(), [&](std::size_t i) {
      std::string& out = buffers.local();
      std::ifstream file(volume.shards[i], std::ios::binary);
      file.rdbuf()->pubsetbuf(nullptr, 0);
      while (file.read(out.data(), static_cast<std::streamsize>(out.size()))) {
      }
    });
  }
  SetBytes(state);
}

void BM_Read(benchmark::State& state) {
  const std::int64_t side = state.range(0);
  const ShardedVolume& volume = VolumeOf(side);
  std::string layer(static_cast<std::size_t>(kChunkSide * side * side * 2), '\0');
  for (auto _ : state) {
    auto store = OpenLocalZarr(volume.folder);
    ISOSCOPE_CHECK(store.ok());
    auto series = OpenZarrSeries(*std::move(store), "", "");
    ISOSCOPE_CHECK(series.ok());
    auto source = (*series)->Open(0, 0, 0);
    ISOSCOPE_CHECK(source.ok());
    for (std::int64_t z = 0; z < side; z += kChunkSide) {
      ISOSCOPE_CHECK((*source)->ReadSlab(z, z + kChunkSide, layer.data()).ok());
    }
    benchmark::DoNotOptimize(layer.data());
  }
  SetBytes(state);
}

#define ISOSCOPE_CHUNKS_BENCHMARK(name) \
  BENCHMARK(name)                       \
      ->ArgName("side")                 \
      ->Arg(128)                        \
      ->Arg(512)                        \
      ->Arg(1024)                       \
      ->MeasureProcessCPUTime()         \
      ->UseRealTime()                   \
      ->Unit(benchmark::kMillisecond)
ISOSCOPE_CHUNKS_BENCHMARK(BM_Decode);
ISOSCOPE_CHUNKS_BENCHMARK(BM_Load);
ISOSCOPE_CHUNKS_BENCHMARK(BM_Read);

}  // namespace
}  // namespace isoscope::source
