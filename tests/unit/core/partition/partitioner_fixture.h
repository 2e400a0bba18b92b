// Helpers for the tests of the partitioner:
//
// - volumes of random samples, and a source that reads them (SourceOf);
// - ExpectDatasetMatches, which compares every block, span and interval tree with brute force;
// - ScriptedSource, which fails, cancels or counts at the n-th read.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_PARTITION_PARTITIONER_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_PARTITION_PARTITIONER_FIXTURE_H_

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/index/interval_tree.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::partition {

struct Volume {
  math::Index3 dims;
  volume::ScalarType type;
  std::string samples;
};

inline volume::GridGeometry GeometryOf(const Volume& v) {
  volume::GridGeometry geometry;
  geometry.sample_dims = v.dims;
  geometry.spacing = {0.5, 1, 2};
  geometry.origin = {-1, -2, -3};
  return geometry;
}

inline std::unique_ptr<source::VolumeSource> SourceOf(const Volume& v) {
  return testing::MakeMemorySource(GeometryOf(v), v.type, v.samples, "/data/noise.raw");
}

inline double SampleAt(const Volume& v, const math::Index3& at) {
  return volume::VisitScalarType(v.type, [&]<typename T>() {
    const auto i = static_cast<std::size_t>((at.z * v.dims.y + at.y) * v.dims.x + at.x);
    return static_cast<double>(base::LoadLittleEndian<T>(v.samples.data() + i * sizeof(T)));
  });
}

inline volume::ScalarSpan BruteForceSpan(const Volume& v, const math::IndexBox& box) {
  volume::ScalarSpan span;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
        const double value = SampleAt(v, {x, y, z});
        if (!std::isnan(value)) {
          span.min = std::min(span.min, value);
          span.max = std::max(span.max, value);
        }
      }
    }
  }
  return span;
}

// The stored samples of a block, cut out of the whole volume.
inline std::string ExpectedBlock(const Volume& v, const math::IndexBox& box) {
  const std::size_t size = volume::SizeOf(v.type);
  std::string bytes;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const auto first = static_cast<std::size_t>((z * v.dims.y + y) * v.dims.x + box.begin.x);
      bytes.append(v.samples, first * size,
                   static_cast<std::size_t>(box.end.x - box.begin.x) * size);
    }
  }
  return bytes;
}

// Opens every shard, compares every block, span and interval tree with brute force.
inline void ExpectDatasetMatches(const std::string& directory, const Volume& v,
                                 const PartitionOptions& options) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto dataset, store::OpenDataset(directory));
  const store::Manifest& manifest = dataset.manifest;
  EXPECT_EQ(manifest.geometry, GeometryOf(v));
  EXPECT_EQ(manifest.scalar_type, v.type);
  EXPECT_EQ(manifest.block_cells, options.block_cells.value_or(volume::DefaultBlockCells(v.dims)));
  EXPECT_EQ(manifest.source, "noise.raw");
  EXPECT_EQ(manifest.value_range, BruteForceSpan(v, {{0, 0, 0}, v.dims}));
  ASSERT_EQ(manifest.shards.size(), static_cast<std::size_t>(options.shard_count));
  std::set<volume::BlockId> seen;
  for (int shard = 0; shard < options.shard_count; ++shard) {
    const std::string shard_directory =
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, options.shard_count));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, store::ShardReader::Open(shard_directory));
    EXPECT_EQ(reader->shard_index(), shard);
    EXPECT_EQ(reader->manifest(), manifest);
    EXPECT_GT(reader->block_count(), 0);
    EXPECT_EQ(reader->ranges().bytes(), dataset.ranges.bytes());
    const volume::BlockLayout& layout = reader->layout();
    std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader->block_count()));
    for (std::size_t i = 0; i < ordinals.size(); ++i) {
      ordinals[i] = static_cast<std::uint32_t>(i);
    }
    std::string buffer;
    std::vector<volume::BlockId> id_of_ordinal;
    for (const auto& run : reader->PlanDiskRuns(ordinals)) {
      buffer.resize(static_cast<std::size_t>(run.size));
      ISOSCOPE_ASSERT_OK(
          reader->ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
            EXPECT_TRUE(seen.insert(block.block_id).second) << "twice: " << block.block_id;
            id_of_ordinal.push_back(block.block_id);
            const std::string expected = ExpectedBlock(v, layout.StoredSamplesOf(block.block_id));
            EXPECT_TRUE(absl::string_view(block.bytes, expected.size()) == expected)
                << "block " << block.block_id;
            EXPECT_EQ(reader->ranges().Get(block.block_id),
                      BruteForceSpan(v, layout.OwnSamplesOf(block.block_id)))
                << "block " << block.block_id;
            return absl::OkStatus();
          }));
    }
    ASSERT_EQ(id_of_ordinal.size(), ordinals.size());

    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        auto file,
        io::OpenRandomAccessFile(absl::StrCat(shard_directory, "/", store::kIntervalTreeFileName)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree,
                                  index::IntervalTree::Open(std::move(file), 64 * base::kKiB));
    for (const double part : {0.0, 0.01, 0.5, 0.9, 1.0}) {
      const double isovalue =
          manifest.value_range.min + part * (manifest.value_range.max - manifest.value_range.min);
      if (!std::isfinite(isovalue)) {
        continue;
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto result, tree->Query(isovalue));
      std::vector<std::uint32_t> found;
      for (const index::BlockInterval& interval : result.active) {
        found.push_back(interval.ordinal);
        EXPECT_EQ(interval.block_id, id_of_ordinal.at(interval.ordinal));
      }
      std::vector<std::uint32_t> expected;
      for (const std::uint32_t ordinal : ordinals) {
        if (volume::IsActive(reader->ranges().Get(id_of_ordinal[ordinal]), isovalue)) {
          expected.push_back(ordinal);
        }
      }
      EXPECT_EQ(found, expected) << isovalue;
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout,
                                volume::BlockLayout::Make(v.dims, manifest.block_cells));
  EXPECT_EQ(static_cast<std::int64_t>(seen.size()), layout.block_count());
}

// Relative path -> content of every file below.
inline std::map<std::string, std::string> FilesBelow(const std::string& directory) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(directory)) {
    if (entry.is_regular_file()) {
      files[std::filesystem::relative(entry.path(), directory).string()] =
          testing::ReadFile(entry.path().string());
    }
  }
  return files;
}

inline std::vector<std::string> EntriesOf(const std::string& directory) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    names.push_back(entry.path().filename().string());
  }
  return names;
}

// Fails, cancels or counts at the n-th read; checks the order if it says that it can't seek.
class ScriptedSource final : public source::VolumeSource {
 public:
  ScriptedSource(std::unique_ptr<source::VolumeSource> source,
                 std::function<absl::Status(int)> before_read, bool is_seekable = true)
      : VolumeSource(InfoOf(source->info(), is_seekable)),
        source_(std::move(source)),
        before_read_(std::move(before_read)) {}
  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const absl::Status status = before_read_(read_count_++);
    rows_read_ += end_row - begin_row;
    if (!info().is_seekable) {
      EXPECT_TRUE(begin_row == next_row_ || begin_row == 0) << begin_row << " " << next_row_;
      next_row_ = end_row;
    }
    return status.ok() ? source_->ReadRows(begin_row, end_row, out) : status;
  }
  [[nodiscard]] int read_count() const { return read_count_; }
  [[nodiscard]] std::int64_t planes_read() const {
    return rows_read_ / info().geometry.sample_dims.y;
  }

 private:
  static source::SourceInfo InfoOf(source::SourceInfo info, bool is_seekable) {
    info.is_seekable = is_seekable;
    return info;
  }

  std::unique_ptr<source::VolumeSource> source_;
  std::function<absl::Status(int)> before_read_;
  int read_count_ = 0;
  std::int64_t rows_read_ = 0;
  std::int64_t next_row_ = 0;
};

inline absl::Status Proceed(int /*read*/) { return absl::OkStatus(); }

// 8 layers of blocks.
inline Volume LayeredVolume() {
  const math::Index3 dims{64, 64, 65};
  return {dims, volume::ScalarType::kUint8, testing::Noise(dims, volume::ScalarType::kUint8)};
}

inline PartitionOptions TwoShards(PartitionOptions options) {
  options.shard_count = 2;
  return options;
}

class PartitionerTest : public ::testing::Test {
 protected:
  PartitionOptions Options(const std::string& name) const {
    PartitionOptions options;
    options.output_directory = dir_.Sub(name);
    return options;
  }
  absl::Status Run(const Volume& v, const PartitionOptions& options) {
    const auto source = SourceOf(v);
    return Partition(*source, options, never_).status();
  }
  // The least limit that is accepted, as the message says it: bands of one row of blocks.
  std::int64_t LeastLimit(source::VolumeSource& source, PartitionOptions options) {
    options.memory_limit_bytes = 1;
    const std::string message(Partition(source, options, never_).status().message());
    const std::size_t at = message.find("needs ");
    EXPECT_NE(at, std::string::npos) << message;
    return at == std::string::npos ? 0 : std::stoll(message.substr(at + 6));
  }
  testing::TempDir dir_;
  base::Cancellation never_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_TESTS_UNIT_CORE_PARTITION_PARTITIONER_FIXTURE_H_
