// Whole runs of Partition, compared with brute force (partitioner_fixture.h):
//
// - every type, block size, distribution and compression gives back the same samples;
// - the same bytes for every memory limit and way of reading;
// - histograms, dataset id and digest;
// - options that are refused, with the message; real volumes where they are present.

#include "core/partition/partitioner.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/index/interval_tree.h"
#include "core/io/file.h"
#include "core/source/adapt/placed_source.h"
#include "core/source/bytes/raw_file.h"
#include "core/store/block_codec.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "tests/support/memory_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;
using volume::ScalarType;

TEST_F(PartitionerTest, EveryBlockOfEveryTypeComesBackFromARawFile) {
  const math::Index3 dims{23, 18, 21};
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
        ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    const std::string name(volume::NameOf(type));
    SCOPED_TRACE(name);
    const Volume v{dims, type, Noise(dims, type)};
    testing::WriteFile(dir_.Sub("noise.raw"), v.samples);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        auto raw, source::OpenRawFile(dir_.Sub("noise.raw"), {.dims = dims, .type = type}));
    const auto source = source::MoveSource(
        std::move(raw),
        {.sample_dims = dims, .spacing = {0.5, 1, 2}, .origin = {-1, -2, -3}, .direction = {}});
    PartitionOptions options = Options(name);
    options.shard_count = 3;
    options.block_cells = {8, 8, 8};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto manifest, Partition(*source, options, never_));
    EXPECT_EQ(manifest.name, name);
    ExpectDatasetMatches(options.output_directory, v, options);
  }
}

TEST_F(PartitionerTest, EveryBlockSizeAndDistributionComesBack) {
  const math::Index3 dims{37, 21, 34};
  const Volume v{dims, ScalarType::kInt16, Noise(dims, ScalarType::kInt16)};
  int number = 0;
  for (const math::Index3& cells :
       {math::Index3{4, 4, 4}, math::Index3{8, 8, 8}, math::Index3{16, 16, 16},
        math::Index3{32, 32, 32}, math::Index3{5, 32, 3}, math::Index3{36, 20, 1}}) {
    for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
      PartitionOptions options = Options(absl::StrCat("d", number++));
      SCOPED_TRACE(options.output_directory);
      options.shard_count = 2;
      options.block_cells = cells;
      options.distribution = distribution;
      ISOSCOPE_ASSERT_OK(Run(v, options));
      ExpectDatasetMatches(options.output_directory, v, options);
    }
  }
}

// The histograms of all shards, added up.
volume::SampleHistogram HistogramOf(const std::string& directory, int shard_count) {
  volume::SampleHistogram sum;
  for (int shard = 0; shard < shard_count; ++shard) {
    const auto reader = store::ShardReader::Open(
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, shard_count)));
    EXPECT_THAT(reader.status(), testing::IsOk());
    const auto histogram = reader.ok() ? (*reader)->ReadHistogram() : reader.status();
    EXPECT_THAT(histogram.status(), testing::IsOk());
    if (!histogram.ok() || !histogram->has_value()) {
      ADD_FAILURE() << "shard " << shard << " has no histogram";
      return sum;
    }
    if (shard == 0) {
      sum = **histogram;
    } else {
      sum.Add(**histogram);
    }
  }
  return sum;
}

TEST_F(PartitionerTest, HistogramsOfAllShardsCountEverySampleOnceWhateverTheShardsAndTheMemory) {
  const math::Index3 dims{45, 38, 50};
  for (const ScalarType type : {ScalarType::kUint8, ScalarType::kInt16, ScalarType::kFloat32}) {
    const Volume v{dims, type, Noise(dims, type)};
    std::map<double, std::int64_t> values;
    for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
      ++values[SampleAt(v, {i % dims.x, i / dims.x % dims.y, i / dims.x / dims.y})];
    }
    std::optional<volume::SampleHistogram> first;
    int number = 0;
    for (const int shards : {1, 3, 7}) {
      for (const std::int64_t limit : {base::kGiB, 4 * base::kMiB}) {
        PartitionOptions options = Options(absl::StrCat(volume::NameOf(type), "-", number++));
        options.shard_count = shards;
        options.memory_limit_bytes = limit;
        options.block_cells = number % 2 == 0 ? math::Index3{8, 8, 8} : math::Index3{5, 16, 3};
        options.distribution =
            number % 3 == 0 ? store::Distribution::kGreedy : store::Distribution::kRandom;
        ISOSCOPE_ASSERT_OK(Run(v, options));
        const volume::SampleHistogram sum = HistogramOf(options.output_directory, shards);
        if (!first.has_value()) {
          std::vector<std::int64_t> expected(static_cast<std::size_t>(sum.bins.count));
          std::int64_t nan_count = math::Volume(dims);
          for (const auto& [value, count] : values) {
            if (!std::isnan(value)) {
              expected.at(static_cast<std::size_t>(sum.bins.IndexOf(value))) += count;
              nan_count -= count;
            }
          }
          EXPECT_EQ(sum.counts, expected);
          EXPECT_EQ(sum.nan_count, nan_count);
          EXPECT_EQ(sum.TotalCount(), math::Volume(dims));
          first = sum;
        }
        EXPECT_EQ(sum, *first) << shards << " shards, limit " << limit;
      }
    }
  }
}

TEST_F(PartitionerTest, ADamagedOrLostHistogramIsDataLossAndTheShardStillOpens) {
  const math::Index3 dims{20, 20, 20};
  const Volume v{dims, ScalarType::kInt16, Noise(dims, ScalarType::kInt16)};
  PartitionOptions options = Options("d");
  options.shard_count = 2;
  ISOSCOPE_ASSERT_OK(Run(v, options));
  const auto path_of = [&](int shard) {
    return absl::StrCat(options.output_directory, "/", store::ShardDirectoryName(shard, 2), "/",
                        store::kHistogramFileName);
  };
  const auto read = [&]() -> absl::Status {
    const auto reader = store::ShardReader::Open(
        absl::StrCat(options.output_directory, "/", store::ShardDirectoryName(0, 2)));
    EXPECT_THAT(reader.status(), testing::IsOk());
    return (*reader)->ReadHistogram().status();
  };
  ISOSCOPE_EXPECT_OK(read());
  const std::string bytes = ReadFile(path_of(0));
  for (const std::size_t at : {std::size_t{3}, std::size_t{70}, bytes.size() - 1}) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 16);
    testing::WriteFile(path_of(0), damaged);
    EXPECT_THAT(read(),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(store::kHistogramFileName)));
  }
  testing::WriteFile(path_of(0), bytes.substr(0, bytes.size() - 8));
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("bytes, expected")));
  testing::WriteFile(path_of(0), ReadFile(path_of(1)));
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("another shard")));
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(path_of(0)));
  EXPECT_THAT(read(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("is missing")));
}

TEST_F(PartitionerTest, EveryCompressionGivesTheSameSamplesInSmallerFiles) {
  const math::Index3 dims{37, 21, 34};
  const Volume smooth{
      dims, ScalarType::kInt16,
      testing::SampleField(testing::GyroidField(2), dims, ScalarType::kInt16, 1000, 0)};
  const Volume noise{dims, ScalarType::kInt16, Noise(dims, ScalarType::kInt16)};
  for (const Volume* v : {&smooth, &noise}) {
    std::map<std::string, std::size_t> size_of_blocks;
    std::map<std::string, std::string> trees;
    for (const char* compression : {"none", "lz4", "zstd", "packed"}) {
      SCOPED_TRACE(compression);
      PartitionOptions options = Options(absl::StrCat(compression, v == &smooth ? "-s" : "-n"));
      options.shard_count = 2;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(options.compression, store::ParseBlockEncoding(compression));
      ISOSCOPE_ASSERT_OK(Run(*v, options));
      ExpectDatasetMatches(options.output_directory, *v, options);
      for (const auto& [path, content] : FilesBelow(options.output_directory)) {
        if (absl::EndsWith(path, store::kBlocksFileName)) {
          size_of_blocks[compression] += content.size();
        } else if (absl::EndsWith(path, store::kIntervalTreeFileName)) {
          EXPECT_EQ(trees.emplace(path, content).first->second, content) << path;
        }
      }
    }
    if (v == &smooth) {
      EXPECT_LT(size_of_blocks["lz4"], size_of_blocks["none"] * 9 / 10);
      EXPECT_LT(size_of_blocks["zstd"], size_of_blocks["lz4"]);
      EXPECT_LT(size_of_blocks["packed"], size_of_blocks["lz4"]);
    } else {
      EXPECT_LE(size_of_blocks["lz4"], size_of_blocks["none"]) << "what grows is stored as it is";
      EXPECT_LE(size_of_blocks["zstd"], size_of_blocks["none"]);
      EXPECT_LE(size_of_blocks["packed"], size_of_blocks["none"]);
    }
  }
}

TEST_F(PartitionerTest, SmallestVolumeIsOneBlock) {
  const Volume v{{2, 2, 2}, ScalarType::kUint8, std::string("\x00\x01\x02\x03\x04\x05\x06\x07", 8)};
  ISOSCOPE_ASSERT_OK(Run(v, Options("one")));
  ExpectDatasetMatches(dir_.Sub("one"), v, Options("one"));
}

TEST_F(PartitionerTest, NanIsLeftOutOfSpansAndAllNanBlocksAreNeverActive) {
  const math::Index3 dims{20, 12, 12};
  Volume v{dims, ScalarType::kFloat32, Noise(dims, ScalarType::kFloat32)};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < v.samples.size() / 4; ++i) {
    if (i % 20 > 9 || i % 7 == 0) {
      base::StoreLittleEndian(nan, v.samples.data() + 4 * i);
    }
  }
  for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
    PartitionOptions options =
        Options(absl::StrCat("nan-", std::string(store::NameOf(distribution))));
    options.shard_count = 2;
    options.block_cells = {4, 4, 4};
    options.distribution = distribution;
    ISOSCOPE_ASSERT_OK(Run(v, options));
    ExpectDatasetMatches(options.output_directory, v, options);
  }
  for (std::size_t i = 0; i < v.samples.size() / 4; ++i) {
    base::StoreLittleEndian(nan, v.samples.data() + 4 * i);
  }
  ISOSCOPE_ASSERT_OK(Run(v, Options("all-nan")));
  ExpectDatasetMatches(dir_.Sub("all-nan"), v, Options("all-nan"));
}

// Infinite samples hide the range that colours need.
TEST_F(PartitionerTest, TheRangeOfFiniteSamplesIsToldWhereOthersAreInfinite) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const math::Index3 dims{20, 12, 12};
  Volume v{dims, ScalarType::kFloat32, std::string(20 * 12 * 12 * 4, '\0')};
  const auto set = [&](std::size_t i, float value) {
    base::StoreLittleEndian(value, v.samples.data() + 4 * i);
  };
  for (std::size_t i = 0; i < v.samples.size() / 4; ++i) {
    set(i, static_cast<float>(i % 37) - 5);
  }
  PartitionOptions options = Options("finite");
  options.block_cells = {4, 4, 4};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest finite,
                                Partition(*SourceOf(v), options, never_));
  EXPECT_EQ(finite.value_range, (volume::ScalarSpan{-5, 31}));
  EXPECT_FALSE(finite.finite_range.has_value());
  set(100, kInfinity);
  set(101, std::numeric_limits<float>::quiet_NaN());
  options.output_directory = dir_.Sub("infinite");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest infinite,
                                Partition(*SourceOf(v), options, never_));
  EXPECT_EQ(infinite.value_range, (volume::ScalarSpan{-5, kInfinity}));
  EXPECT_EQ(infinite.finite_range, (volume::ScalarSpan{-5, 31}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto shard,
      store::ShardReader::Open(dir_.Sub("infinite") + "/" + store::ShardDirectoryName(0, 1)));
  EXPECT_EQ(shard->manifest().finite_range, infinite.finite_range);
  ISOSCOPE_EXPECT_OK(shard->ReadHistogram().status());
  for (std::size_t i = 0; i < v.samples.size() / 4; ++i) {
    set(i, -kInfinity);
  }
  options.output_directory = dir_.Sub("all-infinite");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest none,
                                Partition(*SourceOf(v), options, never_));
  EXPECT_EQ(none.value_range, (volume::ScalarSpan{-kInfinity, -kInfinity}));
  EXPECT_EQ(none.finite_range, volume::ScalarSpan());
}

TEST_F(PartitionerTest, SameInputGivesTheSameBytesForEveryMemoryLimitAndWayOfReading) {
  // From bands of one row of blocks, by layers, to 4 layers a portion; 8 layers and 12 rows in all.
  const math::Index3 dims{96, 91, 60};
  const Volume v{dims, ScalarType::kFloat32,
                 testing::SampleField(testing::GyroidField(3), dims, ScalarType::kFloat32, 1, 0)};
  using store::BlockEncoding;
  using store::Distribution;
  const std::pair<Distribution, BlockEncoding> ways[] = {
      {Distribution::kRandom, BlockEncoding::kRaw},
      {Distribution::kGreedy, BlockEncoding::kRaw},
      {Distribution::kRandom, BlockEncoding::kPacked},
      {Distribution::kGreedy, BlockEncoding::kZstd}};
  for (const auto& [distribution, encoding] : ways) {
    std::map<std::string, std::string> first;
    PartitionOptions options = Options("same");
    options.shard_count = 3;
    options.distribution = distribution;
    options.compression = encoding;
    for (const bool is_seekable : {true, false}) {
      ScriptedSource probe(SourceOf(v), Proceed, is_seekable);
      const std::int64_t least = LeastLimit(probe, options);
      for (const std::int64_t more : {0, 60000, 300000, 1 << 30}) {
        SCOPED_TRACE(absl::StrCat("seekable ", is_seekable, " limit ", least + more));
        options.memory_limit_bytes = least + more;
        // With the largest limit, buffers are large enough to be written past the page cache.
        options.max_cached_bytes = is_seekable ? 0 : std::int64_t{1} << 40;
        ScriptedSource source(SourceOf(v), Proceed, is_seekable);
        ISOSCOPE_ASSERT_OK(Partition(source, options, never_).status());
        if (!is_seekable) {  // bands come from the scratch file
          EXPECT_EQ(source.planes_read(), distribution == Distribution::kGreedy ? 120 : 60);
        }
        const auto files = FilesBelow(options.output_directory);
        EXPECT_EQ(files.size(), 3u * 7u + 2u);
        if (first.empty()) {
          ExpectDatasetMatches(options.output_directory, v, options);
          first = files;
        }
        EXPECT_TRUE(files == first);
        std::filesystem::remove_all(options.output_directory);
      }
    }
  }
}

TEST_F(PartitionerTest, DatasetIdDependsOnContentAndParametersNotOnTheName) {
  const math::Index3 dims{17, 17, 17};
  Volume v{dims, ScalarType::kUint8, Noise(dims, ScalarType::kUint8)};
  const auto id_of = [&](const PartitionOptions& options) {
    const auto source = SourceOf(v);
    const auto manifest = Partition(*source, options, never_);
    EXPECT_THAT(manifest.status(), testing::IsOk());
    return manifest.ok() ? manifest->dataset_id : "";
  };
  PartitionOptions options = Options("a");
  options.block_cells = {4, 4, 4};
  options.shard_count = 2;
  const std::string id = id_of(options);
  EXPECT_EQ(id.size(), 32u);
  options.output_directory = dir_.Sub("b");
  EXPECT_EQ(id_of(options), id);
  options.output_directory = dir_.Sub("c");
  options.seed = 2;
  EXPECT_NE(id_of(options), id);
  options.seed = 1;
  v.samples[100] = static_cast<char>(v.samples[100] ^ 1);
  options.output_directory = dir_.Sub("d");
  EXPECT_NE(id_of(options), id);
}

TEST_F(PartitionerTest, SamplesDigestDependsOnSamplesAloneNotOnHowTheyAreCut) {
  const math::Index3 dims{17, 19, 23};
  Volume v{dims, ScalarType::kInt16, Noise(dims, ScalarType::kInt16)};
  int count = 0;
  const auto digest_of = [&](PartitionOptions options) {
    options.output_directory = dir_.Sub(absl::StrCat("digest-", count++));
    const auto source = SourceOf(v);
    const auto manifest = Partition(*source, options, never_);
    EXPECT_THAT(manifest.status(), testing::IsOk());
    return manifest.ok() ? manifest->samples_digest : "";
  };
  PartitionOptions options = Options("unused");
  const std::string digest = digest_of(options);
  EXPECT_EQ(digest.size(), 32u);
  for (const math::Index3& cells :
       {math::Index3{1, 2, 3}, {5, 5, 5}, {16, 18, 22}, {128, 4, 128}}) {
    options.block_cells = cells;
    EXPECT_EQ(digest_of(options), digest) << cells.x << " " << cells.y << " " << cells.z;
  }
  options.block_cells = {4, 4, 4};
  options.shard_count = 3;
  options.seed = 9;
  EXPECT_EQ(digest_of(options), digest);
  options.distribution = store::Distribution::kGreedy;
  options.compression = store::BlockEncoding::kZstd;
  EXPECT_EQ(digest_of(options), digest);
  v.samples.back() = static_cast<char>(v.samples.back() ^ 1);
  EXPECT_NE(digest_of(options), digest);
}

TEST_F(PartitionerTest, BadOptionsSayWhatIsAllowed) {
  const math::Index3 dims{17, 17, 33};
  const Volume v{dims, ScalarType::kUint16, Noise(dims, ScalarType::kUint16)};
  const auto expect = [&](auto change, absl::StatusCode code, const char* what) {
    PartitionOptions options = Options("bad");
    change(&options);
    EXPECT_THAT(Run(v, options), StatusIs(code, HasSubstr(what)));
    EXPECT_THAT(EntriesOf(dir_.path()), ::testing::IsEmpty()) << what;
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  expect([](auto* o) { o->shard_count = 0; }, kInvalid, "expected 1 to 16");
  expect([](auto* o) { o->shard_count = -5; }, kInvalid, "-5 shards");
  expect([](auto* o) { o->shard_count = 17; }, kInvalid, "17 shards for 16 blocks");
  expect([](auto* o) { o->block_cells = {0, 8, 8}; }, kInvalid, "0 x 8 x 8");
  expect([](auto* o) { o->block_cells = {8, 8, 129}; }, kInvalid, "1 to 128");
  expect([](auto* o) { o->memory_limit_bytes = 1000; }, kInvalid, "raise --memory-limit");
  expect([](auto* o) { o->memory_limit_bytes = -1; }, kInvalid, "-1 bytes");
  expect([](auto* o) { o->output_directory = ""; }, kInvalid, "letters");
  expect([](auto* o) { o->output_directory = "/"; }, kInvalid, "letters");
  expect([](auto* o) { o->output_directory += "/.."; }, kInvalid, "\"..\"");
  expect([](auto* o) { o->output_directory += " x"; }, kInvalid, "bad x");
  expect([](auto* o) { o->output_directory += std::string(300, 'x'); }, kInvalid, "1 to 200");
  expect([](auto* o) { o->output_directory += "/deeper/still"; }, absl::StatusCode::kNotFound,
         "mkdir -p");
  PartitionOptions options = Options("there");
  std::filesystem::create_directory(options.output_directory);
  EXPECT_THAT(Run(v, options), StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("there")));
  EXPECT_THAT(EntriesOf(dir_.path()), ::testing::ElementsAre("there"));
}

TEST_F(PartitionerTest, MemoryLimitThatTheMessageAsksForIsEnough) {
  const math::Index3 dims{100, 100, 60};
  const Volume v{dims, ScalarType::kFloat64, Noise(dims, ScalarType::kFloat64)};
  PartitionOptions options = Options("tight");
  options.memory_limit_bytes = base::kMiB;
  const absl::Status status = Run(v, options);
  ASSERT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("needs ")));
  const std::string message(status.message());
  options.memory_limit_bytes = std::stoll(message.substr(message.find("needs ") + 6));
  ISOSCOPE_ASSERT_OK(Run(v, options));
  ExpectDatasetMatches(options.output_directory, v, options);
  options.output_directory = dir_.Sub("tighter");
  --options.memory_limit_bytes;
  EXPECT_THAT(Run(v, options), StatusIs(absl::StatusCode::kInvalidArgument, _));
}

TEST_F(PartitionerTest, TrailingSlashAndRelativeOutputWork) {
  const Volume v{{3, 3, 3}, ScalarType::kUint8, Noise({3, 3, 3}, ScalarType::kUint8)};
  PartitionOptions options = Options("slash//");
  ISOSCOPE_ASSERT_OK(Run(v, options));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto dataset, store::OpenDataset(dir_.Sub("slash")));
  EXPECT_EQ(dataset.manifest.name, "slash");
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(dir_.path());
  options.output_directory = "relative";
  const absl::Status status = Run(v, options);
  std::filesystem::current_path(before);
  ISOSCOPE_ASSERT_OK(status);
  EXPECT_TRUE(store::IsDatasetDirectory(dir_.Sub("relative")));
}

TEST_F(PartitionerTest, EveryPlaneIsReadOnceAPass) {
  for (const auto distribution : {store::Distribution::kRandom, store::Distribution::kGreedy}) {
    ScriptedSource source(SourceOf(LayeredVolume()), Proceed);
    PartitionOptions options = Options(std::string(store::NameOf(distribution)));
    options.shard_count = 2;
    options.distribution = distribution;
    std::vector<std::string> phases;
    PartitionProgress last;
    options.progress = [&](const PartitionProgress& progress) {
      if (phases.empty() || phases.back() != progress.phase) {
        phases.emplace_back(progress.phase);
      }
      EXPECT_GE(progress.done_bytes, last.done_bytes);
      last = progress;
    };
    ISOSCOPE_ASSERT_OK(Partition(source, options, never_).status());
    const bool is_greedy = distribution == store::Distribution::kGreedy;
    EXPECT_EQ(source.planes_read(), is_greedy ? 130 : 65);
    EXPECT_EQ(last.total_bytes, source.planes_read() * 64 * 64);
    EXPECT_EQ(last.done_bytes, last.total_bytes);
    EXPECT_EQ(phases.front(), is_greedy ? "reading ranges" : "writing blocks");
    EXPECT_EQ(phases.back(), "building index");
  }
}

TEST_F(PartitionerTest, ShardCanBeCopiedAndOpenedAlone) {
  const Volume v = LayeredVolume();
  ISOSCOPE_ASSERT_OK(Run(v, TwoShards(Options("set"))));
  std::filesystem::rename(dir_.Sub("set") + "/" + store::ShardDirectoryName(1, 2),
                          dir_.Sub("elsewhere"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, store::ShardReader::Open(dir_.Sub("elsewhere")));
  EXPECT_EQ(reader->shard_index(), 1);
  EXPECT_EQ(reader->manifest().name, "set");
}

std::string DataDirectory() {
  const char* from_environment = std::getenv("ISOSCOPE_DATA_DIR");
  return from_environment != nullptr ? from_environment : ISOSCOPE_DEFAULT_DATA_DIR;
}

TEST_F(PartitionerTest, RealVolumesMatchWhatTheirReadMeSays) {
  const struct {
    const char* name;
    math::Index3 dims;
    ScalarType type;
    volume::ScalarSpan values;
    double isovalue;
    std::int64_t triangle_count;  // there, counted block by block
  } volumes[] = {{"ironprot", {68, 68, 68}, ScalarType::kUint8, {0, 255}, 60, 27180},
                 {"headsq_quarter", {64, 64, 93}, ScalarType::kUint16, {0, 3926}, 1150, 78476},
                 {"ct_pitch", {175, 248, 58}, ScalarType::kUint8, {0, 255}, 80, 498826}};
  for (const auto& real : volumes) {
    const std::string path = absl::StrCat(DataDirectory(), "/", real.name, ".nrrd");
    if (!io::PathExists(path)) {
      ISOSCOPE_SKIP("data", path + " is absent; set ISOSCOPE_DATA_DIR");
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, source::OpenVolumeFile(path));
    EXPECT_EQ(source->info().geometry.sample_dims, real.dims);
    EXPECT_EQ(source->info().type, real.type);
    PartitionOptions options = Options(real.name);
    options.shard_count = 4;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto manifest, Partition(*source, options, never_));
    EXPECT_EQ(manifest.value_range, real.values);
    EXPECT_EQ(manifest.source, absl::StrCat(real.name, ".nrrd"));

    const volume::SampleHistogram histogram = HistogramOf(options.output_directory, 4);
    EXPECT_EQ(histogram.TotalCount(), math::Volume(real.dims));
    EXPECT_GT(histogram.counts.front(), 0);
    EXPECT_GT(histogram.counts.back(), 0);
    PartitionOptions whole = Options(absl::StrCat(real.name, "-1"));
    ISOSCOPE_ASSERT_OK(Partition(*source, whole, never_).status());
    EXPECT_EQ(HistogramOf(whole.output_directory, 1), histogram) << real.name;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto dataset, store::OpenDataset(whole.output_directory));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout,
                                  volume::BlockLayout::Make(real.dims, manifest.block_cells));
    std::int64_t estimate = 0;
    for (const volume::BlockId id : dataset.ranges.ActiveBlocks(real.isovalue).Ids()) {
      estimate += volume::EstimateTriangles(layout.CellsOf(id).dims());
    }
    EXPECT_LT(estimate, 2 * real.triangle_count) << real.name;
    EXPECT_GT(2 * estimate, real.triangle_count) << real.name;
  }
}

}  // namespace
}  // namespace isoscope::partition
