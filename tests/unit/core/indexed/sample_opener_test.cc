#include "core/indexed/sample_opener.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "core/base/thread_interrupt.h"
#include "core/indexed/unit_cache.h"
#include "core/io/file.h"
#include "core/partition/distribution.h"
#include "core/source/chunks/shard_indexes.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_layout.h"
#include "tests/support/draws.h"
#include "tests/support/hdf5_volume_file.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/indexed/indexed_fixture.h"

namespace isoscope::indexed {
namespace {

using ::isoscope::testing::Cut;
using ::isoscope::testing::CutParts;
using ::isoscope::testing::CutSeries;
using ::isoscope::testing::ReadBlocks;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::StoredBlocks;
using ::testing::AllOf;
using ::testing::HasSubstr;

namespace fs = std::filesystem;

constexpr SourceAccess kOwn{.allows_local_files = true};

// The bits of a sample are those of `type`; 64-bit integers have zeros behind them.
struct Kind {
  volume::ScalarType type;
  const char* dtype;
  std::size_t bytes;
};
constexpr std::array<Kind, 7> kKinds = {{{volume::ScalarType::kUint8, "|u1", 1},
                                         {volume::ScalarType::kInt16, "<i2", 2},
                                         {volume::ScalarType::kUint16, "<u2", 2},
                                         {volume::ScalarType::kUint16, ">u2", 2},
                                         {volume::ScalarType::kUint16, "<f2", 2},
                                         {volume::ScalarType::kUint8, "<i8", 8},
                                         {volume::ScalarType::kFloat32, "<f4", 4}}};

class SampleOpenerTest : public ::testing::Test {
 protected:
  // A volume of noise as a raw file, and its request.
  source::OpenRequest WriteRaw(const math::Index3& dims, const Kind& kind) {
    samples_ = testing::SampleNoise(7, dims, kind.type, 100);
    testing::WriteFile(dir_.Sub("a.raw"), std::string(13, 'h') + samples_);
    return {.path = dir_.Sub("a.raw"),
            .raw = source::RawFormat{.dims = dims,
                                     .type = kind.type,
                                     .is_big_endian = kind.dtype[0] == '>',
                                     .header_bytes = 13}};
  }
  source::OpenRequest WriteZarr(const math::Index3& dims, const Kind& kind,
                                const math::Index3& chunk) {
    const std::string noise = testing::SampleNoise(7, dims, kind.type, 100);
    const std::size_t size = volume::SizeOf(kind.type);
    samples_.clear();
    for (std::size_t i = 0; i < noise.size(); i += size) {
      samples_ += noise.substr(i, size) + std::string(kind.bytes - size, '\0');
    }
    testing::WriteZarr(dir_.Sub("a.zarr"), dims, kind.dtype, kind.bytes, chunk, samples_);
    return {.path = dir_.Sub("a.zarr")};
  }
  // Of kinds that VTK has; `block_bytes` as for testing::WriteVti.
  source::OpenRequest WriteVti(const math::Index3& dims, const Kind& kind,
                               std::size_t block_bytes) {
    const std::map<volume::ScalarType, std::string> names = {
        {volume::ScalarType::kUint8, "UInt8"},
        {volume::ScalarType::kInt16, "Int16"},
        {volume::ScalarType::kUint16, "UInt16"},
        {volume::ScalarType::kFloat32, "Float32"}};
    samples_ = testing::SampleNoise(7, dims, kind.type, 100);
    testing::WriteVti(dir_.Sub("a.vti"), dims, names.at(kind.type), 1, block_bytes, samples_);
    return {.path = dir_.Sub("a.vti")};
  }
  // Of any filters; a plain one if there is no `dice`.
  source::OpenRequest WriteHdf5(const math::Index3& dims, const Kind& kind,
                                const math::Index3& chunk, testing::Dice* dice) {
    WriteZarr(dims, kind, chunk);  // for the samples
    const std::map<std::string, std::pair<hid_t, hid_t>> types = {
        {"|u1", {H5T_STD_U8LE, H5T_STD_U8LE}},    {"<i2", {H5T_STD_I16LE, H5T_STD_I16LE}},
        {"<u2", {H5T_STD_U16LE, H5T_STD_U16LE}},  {">u2", {H5T_STD_U16BE, H5T_STD_U16LE}},
        {"<f2", {H5T_STD_U16BE, H5T_STD_U16LE}},  {"<i8", {H5T_STD_I64LE, H5T_STD_I64LE}},
        {"<f4", {H5T_IEEE_F32LE, H5T_IEEE_F32LE}}};
    testing::Hdf5VolumeFile file{
        .dims = dims,
        .file_type = types.at(kind.dtype).first,
        .memory_type = types.at(kind.dtype).second,
        .chunk = {std::min(chunk.z, dims.z), std::min(chunk.y, dims.y), std::min(chunk.x, dims.x)}};
    if (dice != nullptr) {
      file.chunk = dice->OneIn(5) ? source::ChunkIndex() : file.chunk;
      file.has_gzip = dice->OneIn(2);
      file.has_shuffle = dice->OneIn(2);
      file.has_checksum = dice->OneIn(3);
      file.is_latest = dice->OneIn(2);
      file.has_plain_edges = file.is_latest && dice->OneIn(2);
      file.skipped_every = static_cast<int>(dice->Whole(0, 3));
      file.missing_every = static_cast<int>(dice->Whole(0, 5));
    }
    testing::WriteHdf5Volume(dir_.Sub("a.h5"), file, samples_);
    return {.path = dir_.Sub("a.h5")};
  }
  partition::PartitionOptions OptionsTo(const std::string& name) const {
    partition::PartitionOptions options;
    options.output_directory = dir_.Sub(name);
    return options;
  }
  // A small index-only dataset "d" of a raw file.
  store::Manifest MakeSmall() {
    const source::OpenRequest request = WriteRaw({30, 20, 10}, kKinds[2]);
    partition::PartitionOptions options = OptionsTo("d");
    options.block_cells = {8, 8, 8};
    auto manifest = Cut(request, options, true);
    EXPECT_THAT(manifest, testing::IsOk());
    return *manifest;
  }
  absl::Status Read(const store::Manifest& manifest, const SourceAccess& access) const {
    return ReadBlocks(dir_.Sub("d"), manifest, MakeSampleOpener(access)).status();
  }

  testing::TempDir dir_;
  std::string samples_;
};

// Any grid, chunks, crop, stride, fill, blocks and shards: the blocks are those of the copy.
TEST_F(SampleOpenerTest, BlocksAreThoseOfTheCopy) {
  testing::Dice dice(testing::DrawSeed());
  constexpr int kDatasets = 60;
  for (int i = 0; i < kDatasets; ++i) {
    SCOPED_TRACE(i);
    const math::Index3 dims{dice.Whole(4, 70), dice.Whole(4, 60), dice.Whole(4, 50)};
    const Kind kind = dice.OneOf(kKinds);
    const math::Index3 chunk{dice.Whole(1, 40), dice.Whole(1, 40), dice.Whole(1, 40)};
    source::OpenRequest request =
        dice.OneIn(4)   ? WriteRaw(dims, kind)
        : dice.OneIn(3) ? WriteHdf5(dims, kind, chunk, &dice)
        : dice.OneIn(3)
            ? WriteVti(dims, kind,
                       dice.OneIn(2) ? 0 : static_cast<std::size_t>(dice.Whole(1, 40000)))
            : WriteZarr(dims, kind, chunk);
    if (dice.OneIn(2)) {
      source::SampleBox& crop = request.crop.emplace();
      for (int axis = 0; axis < 3; ++axis) {
        crop.begin[axis] = dice.Whole(0, dims[axis] - 4);
        crop.end[axis] = dice.Whole(crop.begin[axis] + 4, dims[axis]);
      }
    }
    request.stride = dice.OneIn(3) ? dice.Whole(2, 3) : 1;
    if (dice.OneIn(3)) {
      request.fill = 3;
    }
    const auto series = source::Open(request);
    ISOSCOPE_ASSERT_OK(series.status());
    partition::PartitionOptions options = OptionsTo(absl::StrCat("copy", i));
    options.block_cells = {dice.Whole(1, 20), dice.Whole(1, 20), dice.Whole(1, 20)};
    options.levels.highest = 0;
    auto copied = Cut(request, options, false);
    if (absl::IsInvalidArgument(copied.status())) {
      continue;  // fewer than two samples on an axis
    }
    ISOSCOPE_ASSERT_OK(copied.status());
    options.output_directory = dir_.Sub(absl::StrCat("index", i));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest one, Cut(request, options, true));
    const auto layout = *volume::BlockLayout::Make(one.geometry.sample_dims, one.block_cells);
    const partition::BlockUnits units(layout, *one.in_source);
    options.shard_count =
        static_cast<int>(dice.Whole(1, std::min<std::int64_t>(units.unit_count(), 7)));
    options.seed = dice.Bits();
    options.output_directory = dir_.Sub(absl::StrCat("shards", i));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest, Cut(request, options, true));
    EXPECT_EQ(manifest.samples_digest, copied->samples_digest);
    EXPECT_EQ(manifest.range_table_crc32c, copied->range_table_crc32c);
    EXPECT_EQ(manifest.value_range, copied->value_range);
    std::int64_t overhang_bytes = 0;
    for (const store::ShardSummary& shard : manifest.shards) {
      overhang_bytes += shard.block_bytes;
    }
    EXPECT_LE(overhang_bytes, copied->shards[0].block_bytes);

    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StoredBlocks expected,
                                  ReadBlocks(dir_.Sub(absl::StrCat("copy", i)), *copied));
    SourceAccess access = kOwn;
    access.max_bytes = std::size_t{8} << 20;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const StoredBlocks found,
        ReadBlocks(options.output_directory, manifest, MakeSampleOpener(access)));
    ASSERT_EQ(found.samples, expected.samples);
    // Blocks of one unit are in one shard, and no shard is empty.
    std::map<std::uint32_t, std::size_t> shard_of_unit;
    for (const auto& [id, shard] : found.shards) {
      ASSERT_EQ(shard_of_unit.emplace(units.UnitOf(id), shard).first->second, shard);
    }
    for (const store::ShardSummary& shard : manifest.shards) {
      EXPECT_GT(shard.block_count, 0);
    }
    for (const char* name : {"copy", "index", "shards", "a.zarr", "a.h5"}) {
      fs::remove_all(dir_.Sub(absl::StrCat(name, name[0] == 'a' ? "" : absl::StrCat(i))));
    }
  }
}

// Any fields, components, steps and chunks of several of these: blocks are those of the copy, and a
// block is in the same shard in each volume. Parts give the same files.
TEST_F(SampleOpenerTest, SeriesAreThoseOfTheCopyInOneProcessOrParts) {
  testing::Dice dice(testing::DrawSeed());
  constexpr int kDatasets = 25;
  int volumes = 0;
  for (int i = 0; i < kDatasets; ++i) {
    SCOPED_TRACE(i);
    const std::string path = dir_.Sub(absl::StrCat("s", i, ".zarr"));
    source::OpenRequest request = testing::WriteSeries(path, &dice);
    request.stride = dice.OneIn(4) ? 2 : 1;
    if (dice.OneIn(4)) {
      request.fields = {request.axes == "TZYX" ? "q"
                        : request.axes.empty() ? "u"
                                               : absl::StrCat("s", i)};
    }
    partition::PartitionOptions options = OptionsTo(absl::StrCat("copy", i));
    options.block_cells = {dice.Whole(1, 12), dice.Whole(1, 12), dice.Whole(1, 5)};
    options.levels.highest = 0;
    options.seed = dice.Bits();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::SeriesManifest copied,
                                  CutSeries(request, options, false));
    options.output_directory = dir_.Sub(absl::StrCat("index", i));
    options.shard_count = static_cast<int>(dice.Whole(1, 4));
    auto indexed = CutSeries(request, options, true);
    if (absl::IsInvalidArgument(indexed.status())) {  // fewer chunks or blocks than shards
      options.shard_count = 1;
      indexed = CutSeries(request, options, true);
    }
    ISOSCOPE_ASSERT_OK(indexed.status());
    ASSERT_EQ(indexed->volumes.size(), copied.volumes.size());
    SourceAccess access = kOwn;
    access.max_bytes = std::size_t{64} << 20;
    const store::OpenSamples open_samples = MakeSampleOpener(access);
    std::map<volume::BlockId, std::size_t> shards;
    for (const store::ScalarVolume& volume : copied.volumes) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const StoredBlocks expected,
          ReadBlocks(dir_.Sub(absl::StrCat("copy", i)), copied, volume.key));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const StoredBlocks found,
          ReadBlocks(options.output_directory, *indexed, volume.key, open_samples));
      ASSERT_EQ(found.samples, expected.samples);
      shards = shards.empty() ? found.shards : shards;
      ASSERT_EQ(found.shards, shards);
      ++volumes;
    }
    const std::map<std::string, std::string> whole = testing::FilesOf(options.output_directory);
    options.output_directory = dir_.Sub(absl::StrCat("parts", i));
    options.name = absl::StrCat("index", i);
    ISOSCOPE_ASSERT_OK(CutParts(request, options, static_cast<int>(dice.Whole(1, 4))));
    ASSERT_EQ(testing::FilesOf(options.output_directory), whole);
    fs::remove_all(path);
  }
  EXPECT_GT(volumes, 2 * kDatasets);
}

TEST_F(SampleOpenerTest, PartsOfOneVolumeAreTheWhole) {
  const source::OpenRequest request = WriteZarr({30, 20, 70}, kKinds[2], {8, 8, 8});
  partition::PartitionOptions options = OptionsTo("d");
  options.block_cells = {8, 8, 4};
  options.shard_count = 3;
  options.levels.highest = 1;
  ISOSCOPE_ASSERT_OK(Cut(request, options, true).status());
  options.output_directory = dir_.Sub("parts/d");
  fs::create_directory(dir_.Sub("parts"));
  ISOSCOPE_ASSERT_OK(CutParts(request, options, 4));
  EXPECT_EQ(testing::FilesOf(dir_.Sub("parts/d")), testing::FilesOf(dir_.Sub("d")));
  // A part of a copied dataset does not fit.
  options.output_directory = dir_.Sub("mixed");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, source::OpenIdentified(request));
  const auto cut = [&](int index) {
    return partition::PartitionPart(
               *series,
               {.volume = options, .part = {.index = index, .count = 2}, .source_members = {}},
               base::Cancellation())
        .status();
  };
  ISOSCOPE_ASSERT_OK(cut(0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(options.in_source.emplace().request, EncodeSourceRequest(request));
  EXPECT_THAT(cut(1), StatusIs(absl::StatusCode::kFailedPrecondition,
                               AllOf(HasSubstr("--index-only"), HasSubstr("a.zarr"))));
}

TEST_F(SampleOpenerTest, AStepThatChangedIsDataLoss) {
  const std::string noise = testing::SampleNoise(5, {10, 10, 30}, volume::ScalarType::kUint8, 100);
  testing::WriteZarrArray(dir_.Sub("t.zarr"), {3, 10, 10, 10}, "|u1", 1, {1, 10, 10, 10}, noise);
  const source::OpenRequest request{.path = dir_.Sub("t.zarr"), .axes = "TZYX"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::SeriesManifest series,
                                CutSeries(request, OptionsTo("d"), true));
  const store::OpenSamples open_samples = MakeSampleOpener(kOwn);
  const auto read = [&](int step) {
    return ReadBlocks(dir_.Sub("d"), series, {.field = 0, .component = 0, .step = step},
                      open_samples)
        .status();
  };
  ISOSCOPE_EXPECT_OK(read(0));
  const std::string chunk = testing::ReadFile(dir_.Sub("t.zarr/1.0.0.0"));
  fs::copy_file(dir_.Sub("t.zarr/2.0.0.0"), dir_.Sub("t.zarr/1.0.0.0"),
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(read(1), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("t.zarr")));
  ISOSCOPE_EXPECT_OK(read(2));
  testing::WriteFile(dir_.Sub("t.zarr/1.0.0.0"), chunk);
  ISOSCOPE_EXPECT_OK(read(1));
  // Steps are fewer, or the field is another one.
  fs::remove_all(dir_.Sub("t.zarr"));
  testing::WriteZarrArray(dir_.Sub("t.zarr"), {2, 10, 10, 10}, "|u1", 1, {1, 10, 10, 10},
                          noise.substr(0, 2000));
  const store::OpenSamples anew = MakeSampleOpener(kOwn);
  EXPECT_THAT(ReadBlocks(dir_.Sub("d"), series, {.field = 0, .component = 0, .step = 2}, anew),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("2 steps")));
  ISOSCOPE_EXPECT_OK(
      ReadBlocks(dir_.Sub("d"), series, {.field = 0, .component = 0, .step = 1}, anew).status());
  // Nothing is appended, by copying or otherwise.
  const auto source = source::OpenIdentified(request);
  partition::PartitionOptions options = OptionsTo("d");
  EXPECT_THAT(partition::AppendToSeries(**source, {.volume = options}, base::Cancellation()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("index-only")));
  options.in_source.emplace();
  EXPECT_THAT(partition::AppendToSeries(**source, {.volume = options}, base::Cancellation()),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

// Symptom: "has 1 components of field "u" at 2 steps", of files of which one was gone.
TEST_F(SampleOpenerTest, AStepThatIsMissingIsNamed) {
  const std::string noise = testing::SampleNoise(5, {10, 10, 40}, volume::ScalarType::kUint8, 100);
  const auto path_of = [&](int step) { return dir_.Sub(absl::StrCat("run_", step, ".vti")); };
  for (int step = 0; step < 4; ++step) {
    testing::WriteVti(path_of(step), {10, 10, 10}, "UInt8", 1, 0,
                      noise.substr(static_cast<std::size_t>(step) * 1000, 1000));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::SeriesManifest series,
                                CutSeries({.path = dir_.Sub("run_*.vti")}, OptionsTo("d"), true));
  const auto read_without = [&](std::vector<int> missing, int read_step = 3) {
    for (const int step : missing) {
      fs::rename(path_of(step), absl::StrCat(path_of(step), ".away"));
    }
    const absl::Status status =
        ReadBlocks(dir_.Sub("d"), series, {.field = 0, .component = 0, .step = read_step},
                   MakeSampleOpener(kOwn))
            .status();
    for (const int step : missing) {
      fs::rename(absl::StrCat(path_of(step), ".away"), path_of(step));
    }
    return status;
  };
  const auto says = [](const std::string& what) {
    return StatusIs(absl::StatusCode::kDataLoss,
                    AllOf(HasSubstr(what), HasSubstr("bring it back as it was")));
  };
  EXPECT_THAT(read_without({2}),
              says("run_*.vti: run_2.vti is missing: 3 are there, of 4 or more steps"));
  EXPECT_THAT(read_without({1, 2}), says("run_*.vti: run_1.vti, run_2.vti are missing"));
  EXPECT_THAT(read_without({3}),
              says("files are missing before run_0.vti, behind run_2.vti or between them"));
  EXPECT_THAT(read_without({0, 2, 3}), says("files are missing beside run_1.vti"));
  // Steps before the last one are other files now: only their samples tell.
  const std::string others = "run_*.vti: step 2 has other samples than were partitioned, and ";
  EXPECT_THAT(read_without({2}, 2), says(others + "there is no run_2.vti"));
  EXPECT_THAT(read_without({1}, 2), says(others + "there is no run_1.vti"));
  ISOSCOPE_EXPECT_OK(read_without({2}, 1));
  // Names do not tell that the first one is missing, and all are there.
  EXPECT_THAT(read_without({0}, 2), says("are not those that were partitioned"));
  fs::copy_file(path_of(0), path_of(2), fs::copy_options::overwrite_existing);
  EXPECT_THAT(read_without({}, 2), says("are not those that were partitioned"));
  ISOSCOPE_EXPECT_OK(read_without({}));
}

// Chunks of several channels: what is decoded counts.
TEST_F(SampleOpenerTest, ChunksOfManyChannelsAreMeasuredWhole) {
  const std::int64_t channels = 5;
  const std::string noise =
      testing::SampleNoise(5, {64, 64, 64 * channels}, volume::ScalarType::kUint8, 100);
  testing::WriteZarrArray(dir_.Sub("c.zarr"), {channels, 64, 64, 64}, "|u1", 1,
                          {channels, 64, 64, 64}, noise);
  const source::OpenRequest request{.path = dir_.Sub("c.zarr"), .axes = "TZYX"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::SeriesManifest series,
                                CutSeries(request, OptionsTo("d"), true));
  SourceAccess access = kOwn;
  const auto read = [&] {
    return ReadBlocks(dir_.Sub("d"), series, {.field = 0, .component = 0, .step = 3},
                      MakeSampleOpener(access))
        .status();
  };
  access.max_bytes = (256 << 10) * 2 * 3 * channels;
  ISOSCOPE_EXPECT_OK(read());
  access.max_bytes -= 8;
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("1.2 MiB")));
  // More than 64 MiB together.
  fs::create_directory(dir_.Sub("h.zarr"));
  testing::WriteFile(
      dir_.Sub("h.zarr/.zarray"),
      R"({"zarr_format": 2, "shape": [90, 128, 128, 64], "chunks": [90, 128, 128, 64],
                         "dtype": "|u1", "order": "C", "fill_value": 0, "filters": null,
                         "compressor": null})");
  EXPECT_THAT(CutSeries({.path = dir_.Sub("h.zarr"), .axes = "TZYX"}, OptionsTo("e"), true),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("90 MiB"), HasSubstr("other channels or steps"))));
}

TEST_F(SampleOpenerTest, AChangedSourceIsDataLoss) {
  const store::Manifest manifest = MakeSmall();
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  // Each sample is one of some block.
  testing::Dice dice(testing::DrawSeed());
  for (int i = 0; i < 200; ++i) {
    std::string bytes = std::string(13, 'h') + samples_;
    const auto at = static_cast<std::size_t>(dice.Whole(13, std::int64_t(bytes.size()) - 1));
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << dice.Whole(0, 7)));
    testing::WriteFile(dir_.Sub("a.raw"), bytes);
    ASSERT_THAT(Read(manifest, kOwn),
                StatusIs(absl::StatusCode::kDataLoss,
                         AllOf(HasSubstr("a.raw"), HasSubstr("the source has changed"))))
        << at;
  }
  // What is no sample does not count, nor does the time of the change.
  testing::WriteFile(dir_.Sub("a.raw"), std::string(13, 'g') + samples_);
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  // Cut off: the opener sees it.
  testing::WriteFile(dir_.Sub("a.raw"), std::string(13, 'h') + samples_.substr(1));
  EXPECT_THAT(Read(manifest, kOwn),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("a.raw"), HasSubstr("the source has changed"))));
}

TEST_F(SampleOpenerTest, AMissingOrDamagedChunkIsDataLoss) {
  const source::OpenRequest request = WriteZarr({30, 20, 10}, kKinds[2], {8, 8, 8});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest, Cut(request, OptionsTo("d"), true));
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  const std::string chunk = dir_.Sub("a.zarr/1.1.1");
  const std::string bytes = testing::ReadFile(chunk);
  fs::remove(chunk);  // its samples are the fill value then
  EXPECT_THAT(Read(manifest, kOwn), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.zarr")));
  testing::WriteFile(chunk, bytes.substr(0, bytes.size() / 2));
  EXPECT_THAT(Read(manifest, kOwn), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.zarr")));
  // The same samples, stored in another way.
  testing::WriteFile(chunk, bytes);
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  fs::remove(dir_.Sub("a.zarr/.zarray"));
  fs::remove_all(dir_.Sub("a.zarr"));
  testing::WriteZarr(dir_.Sub("a.zarr"), {30, 20, 10}, "<u2", 2, {5, 9, 7}, samples_);
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  // Another volume.
  fs::remove_all(dir_.Sub("a.zarr"));
  testing::WriteZarr(dir_.Sub("a.zarr"), {20, 30, 10}, "<u2", 2, {8, 8, 8}, samples_);
  EXPECT_THAT(Read(manifest, kOwn),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("20 x 30 x 10")));
}

TEST_F(SampleOpenerTest, AChangedHdf5FileIsDataLoss) {
  const source::OpenRequest request = WriteHdf5({30, 20, 10}, kKinds[2], {8, 8, 8}, nullptr);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest, Cut(request, OptionsTo("d"), true));
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
  const std::string bytes = testing::ReadFile(request.path);
  // The first row of samples stands in a chunk only once.
  const std::size_t at = bytes.find(samples_.substr(0, 16));
  ASSERT_NE(at, std::string::npos);
  std::string changed = bytes;
  changed[at] = static_cast<char>(changed[at] ^ 1);
  testing::WriteFile(request.path, changed);
  EXPECT_THAT(Read(manifest, kOwn),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("a.h5"), HasSubstr("the source has changed"))));
  testing::WriteFile(request.path, bytes.substr(0, bytes.size() / 2));
  EXPECT_THAT(Read(manifest, kOwn), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.h5")));
  // The same samples, stored in another way.
  WriteHdf5({30, 20, 10}, kKinds[2], {5, 9, 7}, nullptr);
  ISOSCOPE_EXPECT_OK(Read(manifest, kOwn));
}

TEST_F(SampleOpenerTest, AMissingSourceIsNotFound) {
  const store::Manifest manifest = MakeSmall();
  fs::rename(dir_.Sub("a.raw"), dir_.Sub("b.raw"));
  EXPECT_THAT(Read(manifest, kOwn),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr("a.raw"), HasSubstr("--allow-source"))));
  fs::create_directory(dir_.Sub("other"));
  fs::rename(dir_.Sub("b.raw"), dir_.Sub("other/a.raw"));
  const std::string recorded = fs::canonical(dir_.Sub("d")).parent_path().string();
  ISOSCOPE_EXPECT_OK(
      Read(manifest, {.allowed = {{.recorded = recorded, .actual = recorded + "/other"}}}));
}

// Symptom: what an agent read of a source that had vanished under it was DATA_LOSS.
TEST_F(SampleOpenerTest, ASourceThatVanishesUnderAReaderIsNotFoundUntilItIsBack) {
  partition::PartitionOptions options = OptionsTo("d");
  options.block_cells = {8, 8, 8};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest,
                                Cut(WriteRaw({70, 130, 132}, kKinds[2]), options, true));
  SourceAccess access = kOwn;
  access.max_bytes = 900'000;  // some of the units: the others are read again
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto shard,
      store::ShardReader::Open(testing::ShardPath(dir_.Sub("d"), manifest, 0),
                               io::OpenRandomAccessFile, MakeSampleOpener(access)));
  const auto read = [&] {
    std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(shard->block_count()));
    std::iota(ordinals.begin(), ordinals.end(), std::uint32_t{0});
    absl::Status status;
    for (const store::ShardReader::DiskRun& run : shard->PlanDiskRuns(ordinals)) {
      std::vector<char> buffer(static_cast<std::size_t>(run.size));
      status.Update(shard->ReadDiskRun(run, ordinals, buffer.data(),
                                       [](const auto& /*block*/) { return absl::OkStatus(); }));
    }
    return status;
  };
  ISOSCOPE_EXPECT_OK(read());
  const std::string path = dir_.Sub("a.raw");
  fs::rename(path, dir_.Sub("b.raw"));
  const absl::Status gone = read();
  EXPECT_THAT(gone, StatusIs(absl::StatusCode::kNotFound,
                             AllOf(HasSubstr("a.raw"), HasSubstr("No such file"),
                                   HasSubstr("bring it back"), HasSubstr("--allow-source"))));
  EXPECT_EQ(base::ReasonOf(gone), base::ErrorReason::kSourceUnreadable);
  fs::create_directory(path);  // something else has its name
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss,
                               AllOf(HasSubstr("the source has changed"), HasSubstr("a.raw"),
                                     HasSubstr("partition it anew"))));
  fs::remove(path);
  fs::rename(dir_.Sub("b.raw"), path);
  ISOSCOPE_EXPECT_OK(read());
  fs::resize_file(path, 500);
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss,
                               AllOf(HasSubstr("a.raw"), HasSubstr("the source has changed"),
                                     HasSubstr("partition it anew"))));
  testing::WriteFile(path, std::string(13, 'h') + samples_);
  ISOSCOPE_EXPECT_OK(read());
  // Other samples are in memory then, which is no reason to keep them.
  testing::WriteFile(path, std::string(13 + samples_.size(), 'h'));
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the source has changed")));
  testing::WriteFile(path, std::string(13, 'h') + samples_);
  absl::SleepFor(UnitCache::kDoubtfulLife);
  ISOSCOPE_EXPECT_OK(read());
}

// Symptom: frames waited, whatever their cancellations, for one that asked a silent server again.
TEST_F(SampleOpenerTest, ACancelledFrameWaitsForNoServerAndOthersGetTheSource) {
  const math::Index3 dims{70, 130, 132};
  const testing::ServedObject object{
      .bytes = absl::StrCat("NRRD0004\ntype: uint16\ndimension: 3\nsizes: 70 130 132\n",
                            "encoding: raw\nendian: little\n\n",
                            testing::SampleNoise(7, dims, volume::ScalarType::kUint16, 100))};
  // Then it says that the object is another one, and answers nothing to who opens it.
  std::atomic<bool> is_silent{false};
  std::atomic<int> opening_count{0};
  testing::ScriptedServer server(
      [&](const testing::ServedRequest& request, testing::ServedConnection* connection) {
        if (!is_silent) {
          testing::ServeObject(object, request, connection);
        } else if (!request.Header("if-match").empty()) {
          connection->Send(testing::Answer(412, "", ""));
        } else {
          ++opening_count;
          connection->Hang();
        }
      });
  partition::PartitionOptions options = OptionsTo("d");
  options.block_cells = {8, 8, 8};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest,
                                Cut({.path = server.origin() + "/v.nrrd"}, options, true));
  const SourceAccess access{.allowed = {{.recorded = server.origin(), .actual = server.origin()}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, MakeSampleOpener(access)(manifest));
  is_silent = true;
  struct Frame {
    base::Cancellation cancellation;
    std::future<absl::Status> read;

    [[nodiscard]] bool HasEnded() const {  // the server's silence is given up much later
      return read.wait_for(std::chrono::seconds(20)) == std::future_status::ready;
    }
  };
  std::array<Frame, 4> frames;
  const auto begin = [&](Frame* frame) {
    frame->read = std::async(std::launch::async, [&reader, frame] {
      std::string samples(11 * 11 * 11 * 2, '\0');
      return reader->ReadBlock(0, frame->cancellation, samples.data());
    });
  };
  auto& [opens, waits, doubts, goes_on] = frames;
  begin(&opens);
  for (int i = 0; i < 2000 && opening_count == 0; ++i) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_GT(opening_count, 0);
  begin(&waits);
  doubts.read = std::async(std::launch::async, [&reader, &doubts] {
    const base::ThreadInterrupt interrupt(doubts.cancellation);
    return reader->Doubt(0);
  });
  begin(&goes_on);
  absl::SleepFor(absl::Milliseconds(50));  // they wait for the first one
  const auto is_cancelled = StatusIs(absl::StatusCode::kCancelled);
  for (Frame* const frame : {&waits, &doubts}) {
    frame->cancellation.Cancel();
    EXPECT_TRUE(frame->HasEnded());
    EXPECT_THAT(frame->read.get(), is_cancelled);
  }
  is_silent = false;
  opens.cancellation.Cancel();
  EXPECT_TRUE(opens.HasEnded());
  EXPECT_THAT(opens.read.get(), is_cancelled);
  EXPECT_TRUE(goes_on.HasEnded());
  ISOSCOPE_EXPECT_OK(goes_on.read.get());
}

// A manifest can make no agent read what its operator does not allow.
TEST_F(SampleOpenerTest, OnlyAllowedSourcesAreRead) {
  const store::Manifest manifest = MakeSmall();
  const std::string root = fs::canonical(dir_.Sub("d")).parent_path().string();
  const auto allowing = [](const std::string& prefix) {
    return SourceAccess{.allowed = {{.recorded = prefix, .actual = prefix}}};
  };
  EXPECT_THAT(Read(manifest, {}), StatusIs(absl::StatusCode::kPermissionDenied,
                                           AllOf(HasSubstr("a.raw"), HasSubstr("--allow-source"))));
  EXPECT_EQ(base::ReasonOf(Read(manifest, {})), base::ErrorReason::kSourceUnreadable);
  ISOSCOPE_EXPECT_OK(Read(manifest, allowing(root)));
  ISOSCOPE_EXPECT_OK(Read(manifest, allowing(root + "/")));
  ISOSCOPE_EXPECT_OK(Read(manifest, allowing(root + "/a.raw")));
  ISOSCOPE_EXPECT_OK(Read(manifest, allowing("/")));
  EXPECT_THAT(Read(manifest, allowing(root + "/a")), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(Read(manifest, allowing(root + "/d")), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(Read(manifest, allowing("https://example.org/")),
              StatusIs(absl::StatusCode::kPermissionDenied));
  // A link leads out of the folder.
  fs::create_directory(root + "/in");
  fs::create_symlink(root + "/a.raw", root + "/in/link.raw");
  store::Manifest linked = manifest;
  linked.in_source->request["path"] = root + "/in/link.raw";
  const auto open = [](const store::Manifest& opened, const SourceAccess& access) {
    return MakeSampleOpener(access)(opened).status();
  };
  EXPECT_THAT(open(linked, allowing(root + "/in")), StatusIs(absl::StatusCode::kPermissionDenied));
  ISOSCOPE_EXPECT_OK(open(linked, allowing(root)));
  // So does a path.
  linked.in_source->request["path"] = root + "/in/../a.raw";
  EXPECT_THAT(open(linked, allowing(root + "/in")), StatusIs(absl::StatusCode::kPermissionDenied));
  // A header names samples elsewhere.
  testing::WriteFile(root + "/in/a.nhdr",
                     "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 30 20 10\nencoding: raw\n"
                     "endian: little\nbyte skip: 13\ndata file: ../a.raw\n");
  linked.in_source->request = {{"path", root + "/in/a.nhdr"}};
  EXPECT_THAT(open(linked, allowing(root + "/in")),
              StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("a.raw")));
  ISOSCOPE_EXPECT_OK(open(linked, allowing(root)));
  // An address is fetched by nobody who does not allow it.
  linked.in_source->request = {{"path", "http://127.0.0.1:1/a.zarr"}};
  EXPECT_THAT(open(linked, kOwn), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(open(linked, allowing("/")), StatusIs(absl::StatusCode::kPermissionDenied));
}

// Breaks if units of another grid are taken for those of a manifest: nobody compares a manifest with
// its id, so a forged one may have that of another dataset.
TEST_F(SampleOpenerTest, UnitsOfAnotherGridAreOthersWhateverTheId) {
  store::Manifest manifest = MakeSmall();
  manifest.in_source->unit_origin = {0, 0, 0};
  manifest.in_source->unit_dims = {8, 8, 8};
  store::Manifest forged = manifest;
  forged.in_source->unit_dims = {32, 32, 32};
  const store::OpenSamples open = MakeSampleOpener(kOwn);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, open(manifest));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto forged_reader, open(forged));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, MakeSampleOpener(kOwn)(forged));
  const base::Cancellation never;
  constexpr math::Index3 kFirst{0, 0, 0};
  ISOSCOPE_ASSERT_OK(reader->ReadUnit(kFirst, never));
  EXPECT_TRUE(reader->HasUnit(kFirst));
  EXPECT_FALSE(forged_reader->HasUnit(kFirst));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
  const math::Index3 stored = layout.StoredSamplesOf(0).dims();
  std::string found(static_cast<std::size_t>(math::Volume(stored)) * sizeof(std::uint16_t), 'x');
  std::string expected = found;
  ISOSCOPE_ASSERT_OK(forged_reader->ReadBlock(0, never, found.data()));
  ISOSCOPE_ASSERT_OK(alone->ReadBlock(0, never, expected.data()));
  EXPECT_EQ(found, expected);
}

TEST_F(SampleOpenerTest, OthersAreRefusedByName) {
  const math::Index3 dims{10, 10, 10};
  const std::string samples = testing::SampleNoise(1, dims, volume::ScalarType::kUint8, 100);
  testing::WriteFile(dir_.Sub("a.nrrd"),
                     "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 10 10 10\nencoding: gzip\n\n" +
                         testing::Gzip(samples));
  EXPECT_THAT(Cut({.path = dir_.Sub("a.nrrd")}, OptionsTo("d"), true),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("a.nrrd"), HasSubstr("can't be indexed alone"))));
  EXPECT_FALSE(fs::exists(dir_.Sub("d")));
  testing::WriteFile(
      dir_.Sub("z.vti"),
      "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt32\" "
      "compressor=\"vtkLZMADataCompressor\"><ImageData WholeExtent=\"0 1 0 1 0 1\" Origin=\"0 0 "
      "0\" "
      "Spacing=\"1 1 1\"><Piece Extent=\"0 1 0 1 0 1\"><PointData><DataArray Name=\"u\" "
      "type=\"UInt8\" format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData>"
      "<AppendedData encoding=\"raw\">_" +
          std::string("\1\0\0\0\x8\0\0\0\0\0\0\0\x4\0\0\0abcd", 20) + "</AppendedData></VTKFile>");
  EXPECT_THAT(Cut({.path = dir_.Sub("z.vti")}, OptionsTo("d"), true),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("z.vti"), HasSubstr("can't be indexed alone"))));
  // Not opened without a way to its source.
  const store::Manifest manifest = MakeSmall();
  EXPECT_THAT(ReadBlocks(dir_.Sub("d"), manifest),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("index-only")));
  // More shards than chunks.
  partition::PartitionOptions options = OptionsTo("e");
  options.shard_count = 9;
  options.block_cells = {8, 8, 8};
  EXPECT_THAT(Cut(WriteZarr({17, 17, 17}, kKinds[0], {100, 100, 100}), options, true),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("9 shards")));
}

TEST_F(SampleOpenerTest, LimitsTheMemoryOfChunks) {
  const source::OpenRequest request = WriteZarr({128, 64, 32}, kKinds[0], {128, 64, 32});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest manifest, Cut(request, OptionsTo("d"), true));
  SourceAccess access = kOwn;
  access.max_bytes = 128 << 10;
  const absl::Status refused = Read(manifest, access);
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("--memory-limit")));
  // So that nobody tries again: it is no matter of time.
  EXPECT_EQ(base::ReasonOf(base::WithRetryDelay(refused, absl::Seconds(1))),
            base::ErrorReason::kTooLarge);
  access.max_bytes = (256 << 10) * 2 * 3;
  ISOSCOPE_EXPECT_OK(Read(manifest, access));
}

TEST(AllowedSourceTest, ParsesPrefixes) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(AllowedSource allowed, ParseAllowedSource("/data"));
  EXPECT_EQ(allowed, (AllowedSource{.recorded = "/data", .actual = "/data"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(allowed, ParseAllowedSource("/data=/mnt/a=b"));
  EXPECT_EQ(allowed, (AllowedSource{.recorded = "/data", .actual = "/mnt/a=b"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(allowed, ParseAllowedSource("https://example.org/a"));
  EXPECT_EQ(allowed.actual, "https://example.org/a");
  for (const char* text : {"", "data", "/data=", "=/data", "/data=mnt"}) {
    EXPECT_THAT(ParseAllowedSource(text), StatusIs(absl::StatusCode::kInvalidArgument)) << text;
  }
}

TEST(AccessOfUserTest, ReadsLocalFilesAndWhatTheEnvironmentAllows) {
  constexpr char kVariable[] = "ISOSCOPE_ALLOW_SOURCE";
  unsetenv(kVariable);  // NOLINT(concurrency-mt-unsafe): one thread
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SourceAccess plain, AccessOfUser());
  EXPECT_TRUE(plain.allows_local_files);
  EXPECT_TRUE(plain.allowed.empty());
  setenv(kVariable, "https://host/a", 1);  // NOLINT(concurrency-mt-unsafe)
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SourceAccess more, AccessOfUser());
  EXPECT_TRUE(more.allows_local_files);
  EXPECT_THAT(more.allowed, ::testing::ElementsAre(AllowedSource{.recorded = "https://host/a",
                                                                 .actual = "https://host/a"}));
  setenv(kVariable, "a", 1);  // NOLINT(concurrency-mt-unsafe)
  EXPECT_THAT(AccessOfUser().status(),
              testing::StatusIs(absl::StatusCode::kInvalidArgument,
                                ::testing::HasSubstr("ISOSCOPE_ALLOW_SOURCE: 'a'")));
  unsetenv(kVariable);  // NOLINT(concurrency-mt-unsafe)
}

// The agent's limit has a share for them.
TEST(SampleOpenerIndexTest, AnOpenerBoundsTheIndexesOfShards) {
  source::ShardIndexes& indexes = source::ShardIndexes::OfProcess();
  const std::int64_t array = indexes.NumberArray();
  constexpr std::size_t kMaxBytes = 4096;
  const store::OpenSamples open =
      MakeSampleOpener({.allows_local_files = true, .max_index_bytes = kMaxBytes});
  for (int shard = 0; shard < 100; ++shard) {
    indexes.Keep(array, absl::StrCat(shard), nullptr);
    EXPECT_LE(indexes.kept_bytes(), std::int64_t{kMaxBytes});
  }
  indexes.Forget(array);
  indexes.SetMaxBytes(source::ShardIndexes::kDefaultMaxBytes);
}

}  // namespace
}  // namespace isoscope::indexed
