// Helpers for tests of levels: brute force from the samples of the volume, and the samples that a
// dataset holds.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_PARTITION_LEVEL_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_PARTITION_LEVEL_FIXTURE_H_

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_levels.h"
#include "core/store/shard_reader.h"
#include "core/volume/volume_level.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {

// One sample of a level from the eight below, in the order x, y, z, as doubles.
template <typename T>
T ReducedSample(const std::vector<double>& s, volume::LevelFilter filter, double scale) {
  if (filter == volume::LevelFilter::kMajority) {
    std::map<double, int> counts;
    for (const double sample : s) {
      ++counts[sample];
    }
    double best = counts.begin()->first;
    for (const auto& [label, count] : counts) {
      best = count > counts[best] ? label : best;
    }
    return static_cast<T>(best);
  }
  // The sums of integers are exact; those of floats go along y, z, x.
  const double mean = ((s[0] / 8 + s[2] / 8) + (s[4] / 8 + s[6] / 8)) +
                      ((s[1] / 8 + s[3] / 8) + (s[5] / 8 + s[7] / 8));
  if constexpr (std::is_floating_point_v<T>) {
    return std::isnan(mean) ? std::numeric_limits<T>::quiet_NaN() : static_cast<T>(mean);
  } else {
    return static_cast<T>(std::nearbyint(mean * scale));
  }
}

// The next level of a volume, or of a level whose samples have `type` already.
inline Volume Reduced(const Volume& v, volume::ScalarType type, volume::LevelFilter filter) {
  const double scale = type == v.type ? 1 : 256;
  Volume out{{v.dims.x / 2, v.dims.y / 2, v.dims.z / 2}, type, ""};
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::int64_t z = 0; z < out.dims.z; ++z) {
      for (std::int64_t y = 0; y < out.dims.y; ++y) {
        for (std::int64_t x = 0; x < out.dims.x; ++x) {
          std::vector<double> samples;
          for (int i = 0; i < 8; ++i) {
            samples.push_back(
                SampleAt(v, {2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2 & 1)}));
          }
          base::AppendLittleEndian(ReducedSample<T>(samples, filter, scale), &out.samples);
        }
      }
    }
  });
  return out;
}

// Copies the samples that the blocks of an open shard hold into a volume.
inline void CopyBlocks(const store::ShardReader& reader, Volume* v) {
  const std::size_t size = volume::SizeOf(v->type);
  std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader.block_count()));
  for (std::size_t i = 0; i < ordinals.size(); ++i) {
    ordinals[i] = static_cast<std::uint32_t>(i);
  }
  std::string buffer;
  for (const auto& run : reader.PlanDiskRuns(ordinals)) {
    buffer.resize(static_cast<std::size_t>(run.size));
    ISOSCOPE_ASSERT_OK(
        reader.ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
          const math::IndexBox box = reader.layout().StoredSamplesOf(block.block_id);
          const char* row = block.bytes;
          const std::size_t row_bytes = static_cast<std::size_t>(box.dims().x) * size;
          for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
            for (std::int64_t y = box.begin.y; y < box.end.y; ++y, row += row_bytes) {
              const auto at =
                  static_cast<std::size_t>((z * v->dims.y + y) * v->dims.x + box.begin.x);
              std::memcpy(v->samples.data() + at * size, row, row_bytes);
            }
          }
          return absl::OkStatus();
        }));
  }
}

inline std::vector<std::string> ShardsOf(const std::string& directory) {
  const auto shards = store::ShardDirectoriesOf(directory);
  EXPECT_THAT(shards.status(), testing::IsOk());
  return shards.ok() ? *shards : std::vector<std::string>();
}

// The samples of a level of a dataset of `v`, as its shards hold them.
inline Volume LevelVolume(const std::string& directory, const Volume& v, int level) {
  Volume found{{}, v.type, ""};
  for (const std::string& shard : ShardsOf(directory)) {
    const auto reader = store::OpenShardLevel(shard, level);
    EXPECT_THAT(reader.status(), testing::IsOk());
    if (!reader.ok()) {
      return found;
    }
    if (found.samples.empty()) {
      found.dims = (*reader)->manifest().geometry.sample_dims;
      found.type = (*reader)->manifest().scalar_type;
      found.samples.assign(
          static_cast<std::size_t>(math::Volume(found.dims)) * volume::SizeOf(found.type), '\x7e');
    }
    CopyBlocks(**reader, &found);
  }
  return found;
}

inline void ExpectLevelsMatch(const std::string& directory, const Volume& v,
                              volume::LevelFilter filter, int highest) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto dataset, store::OpenDataset(directory));
  ASSERT_EQ(dataset.manifest.highest_level(), highest);
  EXPECT_EQ(dataset.manifest.level_filter, filter);
  Volume below = v;
  for (int level = 1; level <= highest; ++level) {
    const Volume expected = Reduced(below, volume::LevelType(v.type, filter), filter);
    const Volume found = LevelVolume(directory, v, level);
    EXPECT_EQ(found.dims, expected.dims);
    EXPECT_EQ(found.type, expected.type);
    EXPECT_TRUE(found.samples == expected.samples) << "level " << level;
    below = expected;
  }
}

// The digests of samples and grid of all levels.
inline std::vector<std::string> LevelDigests(const std::string& directory) {
  std::vector<std::string> digests;
  const std::vector<std::string> shards = ShardsOf(directory);
  for (int level = 1; !shards.empty(); ++level) {
    const auto reader = store::OpenShardLevel(shards.back(), level);
    if (!reader.ok()) {
      EXPECT_THAT(reader.status(), testing::StatusIs(absl::StatusCode::kNotFound));
      break;
    }
    digests.push_back((*reader)->manifest().samples_digest);
  }
  return digests;
}

}  // namespace isoscope::partition

#endif  // ISOSCOPE_TESTS_UNIT_CORE_PARTITION_LEVEL_FIXTURE_H_
