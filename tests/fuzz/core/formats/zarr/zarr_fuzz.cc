// Stores of Zarr: metadata, chunks, shards and archives of strangers. An input is a list of objects,
// a key and its bytes each; or, if its first byte is odd, an archive.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/formats/zarr/zarr_series.h"
#include "core/formats/zarr/zarr_store.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/memory_store.h"
#include "tests/support/zip_writer.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::fuzz {
namespace {

using testing::Objects;
using testing::PlainArray;

constexpr std::int64_t kMaxReadBytes = std::int64_t{1} << 20;

void RequireZarrError(const absl::Status& status) {
  using absl::StatusCode;
  RequireError(status, {StatusCode::kNotFound, StatusCode::kInvalidArgument, StatusCode::kDataLoss,
                        StatusCode::kOutOfRange, StatusCode::kResourceExhausted});
}

// In one piece and row by row.
void ReadVolume(source::VolumeSource* volume) {
  const math::Index3& dims = volume->info().geometry.sample_dims;
  Require(volume::Validate(volume->info().geometry).ok(), "an opened volume has a valid grid");
  constexpr std::int64_t kMaxMemoryBytes = std::int64_t{512} << 20;
  if (math::Volume(dims) > kMaxReadBytes / 8 || volume->info().memory_bytes > kMaxMemoryBytes) {
    return;
  }
  const auto size = static_cast<std::size_t>(dims.y * dims.z * volume->info().row_bytes());
  const auto whole = std::make_unique<char[]>(size);
  const absl::Status status = volume->ReadRows(0, dims.y * dims.z, whole.get());
  if (!status.ok()) {
    RequireZarrError(status);
    return;
  }
  const auto row = std::make_unique<char[]>(static_cast<std::size_t>(volume->info().row_bytes()));
  for (std::int64_t y = 0; y < dims.y * dims.z; ++y) {
    Require(volume->ReadRows(y, y + 1, row.get()).ok(), "what can be read can be read in parts");
    Require(std::string(row.get(), static_cast<std::size_t>(volume->info().row_bytes())) ==
                std::string(whole.get() + y * volume->info().row_bytes(),
                            static_cast<std::size_t>(volume->info().row_bytes())),
            "rows are the same alone");
  }
}

void OpenAndRead(absl::StatusOr<std::unique_ptr<source::ZarrStore>> store,
                 const std::string& part) {
  if (!store.ok()) {
    RequireZarrError(store.status());
    return;
  }
  const auto series = source::OpenZarrSeries(*std::move(store), part, "");
  if (!series.ok()) {
    RequireZarrError(series.status());
    return;
  }
  const int fields = std::min(static_cast<int>((*series)->info().fields.size()), 2);
  for (int field = 0; field < fields; ++field) {
    const auto volume = (*series)->Open(field, 0, (*series)->info().step_count() - 1);
    if (volume.ok()) {
      ReadVolume(volume->get());
    } else {
      RequireZarrError(volume.status());
    }
  }
}

void OpenArchive(std::string bytes, const std::string& part) {
  OpenAndRead(
      source::OpenZippedZarr(std::make_shared<const testing::MemoryBytes>(std::move(bytes))), part);
}

std::string SeedOf(const Objects& objects) {
  std::string seed(1, '\0');
  seed += MakePiece("");
  for (const auto& [key, bytes] : objects) {
    seed += MakePiece(key) + MakePiece(bytes);
  }
  return seed;
}

Objects ImageObjects() {
  Objects objects = {
      {"zarr.json", testing::Zarr3Group(R"({"ome": {"version": "0.5", "multiscales": [{"axes": [
          {"name": "c", "type": "channel"}, {"name": "z", "type": "space", "unit": "micrometer"},
          {"name": "y", "type": "space", "unit": "micrometer"},
          {"name": "x", "type": "space", "unit": "micrometer"}], "datasets": [{"path": "0",
          "coordinateTransformations": [{"type": "scale", "scale": [1, 2, 1, 1]},
          {"type": "translation", "translation": [0, 1, 1, 1]}]}]}]}})")}};
  objects["0/zarr.json"] = testing::Zarr3Text(
      {2, 4, 4, 4}, {1, 4, 4, 4}, "uint16", "",
      R"([{"name": "sharding_indexed", "configuration": {"chunk_shape": [1, 2, 2, 4],
          "codecs": [{"name": "bytes", "configuration": {"endian": "big"}}, "gzip", "crc32c"],
          "index_codecs": ["bytes"], "index_location": "start"}}])");
  testing::ShardFile shard;
  shard.is_index_at_end = false;
  shard.has_checksum = false;
  testing::AddChunks(
      "0", PlainArray::Counting({2, 4, 4, 4}, 2),
      {.chunk_dims = {1, 2, 2, 4},
       .shard_dims = {1, 4, 4, 4},
       .encode = [](const std::string& b) { return testing::WithCrc32c(testing::Gzip(b)); },
       .shard = shard,
       .fill = std::string(2, '\0')},
      true, &objects);
  return objects;
}

Objects XarrayObjects() {
  const std::string dims = R"({"_ARRAY_DIMENSIONS": ["time", "z", "y", "x"], "scale_factor": 0.5})";
  Objects objects = {
      {".zgroup", "{\"zarr_format\": 2}"},
      {"t/.zarray",
       testing::Zarr2Text({2, 2, 3, 4}, {1, 2, 2, 3}, ">i2",
                          R"(, "order": "F", "fill_value": -9, "compressor": {"id": "zlib"},
                             "filters": [{"id": "shuffle", "elementsize": 2}])")},
      {"t/.zattrs", dims},
      {"x/.zarray", testing::Zarr2Text({4}, {4}, "<f8")},
      {"x/.zattrs", R"({"_ARRAY_DIMENSIONS": ["x"], "units": "m"})"},
      {"x/0", testing::NumberText<double>({0, 1, 2, 3})}};
  testing::AddChunks("t", PlainArray::Counting({2, 2, 3, 4}, 2),
                     {.chunk_dims = {1, 2, 2, 3},
                      .encode = [](const std::string& b) { return testing::Deflate(b, 15); },
                      .fill = std::string(2, '\0')},
                     false, &objects);
  return objects;
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds = {SeedOf(ImageObjects()), SeedOf(XarrayObjects())};
  for (const char* codec :
       {"\"zstd\"", "\"blosc\"", "\"bz2\"", "\"numcodecs.lz4\"", "\"fletcher32\"",
        R"({"name": "numcodecs.shuffle", "configuration": {"elementsize": 2}})"}) {
    seeds.push_back(
        SeedOf({{"zarr.json", testing::Zarr3Text({2, 3, 4}, {2, 3, 4}, "uint16", "",
                                                 absl::StrCat("[\"bytes\", ", codec, "]"))},
                {"c/0/0/0", std::string(48, 'a')}}));
  }
  for (const char* codec :
       {R"({"name": "scale_offset", "configuration": {"offset": 1, "scale": 2}})",
        R"({"name": "cast_value", "configuration": {"data_type": "int16"}})",
        R"({"name": "numcodecs.delta", "configuration": {"dtype": "<f4", "astype": "<i2"}})",
        R"({"name": "transpose", "configuration": {"order": [2, 0, 1]}})"}) {
    seeds.push_back(
        SeedOf({{"zarr.json", testing::Zarr3Text({2, 3, 4}, {2, 3, 4}, "float32", "",
                                                 absl::StrCat("[", codec, ", \"bytes\"]"))},
                {"c/0/0/0", std::string(96, '\1')}}));
  }
  for (const bool is_64 : {false, true}) {
    testing::ZipWriter zip(is_64);
    for (const auto& [key, bytes] : ImageObjects()) {  // again below: the last one counts
      zip.Add(key, bytes.substr(bytes.size() / 2), true);
    }
    for (const auto& [key, bytes] : ImageObjects()) {
      zip.Add(key, bytes, key.size() > 9);
    }
    seeds.push_back(std::string(1, '\1') + MakePiece("") + zip.Finish());
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const bool is_archive = (input.Byte() & 1) != 0;
  const std::string part(input.Piece());
  if (is_archive) {
    OpenArchive(std::string(input.Rest()), part);
    return 0;
  }
  Objects objects;
  while (!input.empty() && objects.size() < 64) {
    const std::string key(input.Piece());
    objects[key] = std::string(input.Piece());
  }
  OpenAndRead(isoscope::testing::OpenObjects(objects), part);
  return 0;
}
