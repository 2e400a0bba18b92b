#include "partition-agent/shard/shard_label_values.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Optional;

constexpr std::size_t kSide = 21;
constexpr std::size_t kSampleCount = kSide * kSide * kSide;

template <typename T>
constexpr volume::ScalarType kTypeOf = volume::ScalarType::kFloat32;
template <>
constexpr volume::ScalarType kTypeOf<double> = volume::ScalarType::kFloat64;
template <>
constexpr volume::ScalarType kTypeOf<std::int32_t> = volume::ScalarType::kInt32;
template <>
constexpr volume::ScalarType kTypeOf<std::uint16_t> = volume::ScalarType::kUint16;

template <typename T>
absl::StatusOr<volume::LabelValues> ValuesOf(const std::vector<T>& samples, int shard_count,
                                             std::size_t max_count = 1000) {
  const testing::TempDir temp;
  const std::string bytes(reinterpret_cast<const char*>(samples.data()),
                          samples.size() * sizeof(T));
  const auto source = testing::MakeMemorySource(
      {.sample_dims = {kSide, kSide, kSide}, .spacing = {1, 1, 1}, .origin = {}, .direction = {}},
      kTypeOf<T>, bytes, "labels");
  partition::PartitionOptions options;
  options.output_directory = temp.Sub("labels");
  options.shard_count = shard_count;
  options.block_cells = {8, 8, 8};
  EXPECT_THAT(partition::Partition(*source, options, base::Cancellation()).status(), IsOk());
  Shards shards;
  for (int i = 0; i < shard_count; ++i) {
    shards.push_back(
        OpenShard(options.output_directory + "/" + store::ShardDirectoryName(i, shard_count))
            .value());
  }
  return LabelValuesOfShards(shards, max_count, base::Cancellation());
}

TEST(ShardLabelValuesTest, WholeNumbersOfEveryTypeAreListed) {
  for (const int shard_count : {1, 3}) {
    std::vector<float> floats(kSampleCount, 0.0F);
    floats[kSampleCount / 2] = 7;
    floats[5] = -3;
    floats[6] = std::numeric_limits<float>::quiet_NaN();
    floats[7] = 16777216;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto float_values, ValuesOf(floats, shard_count));
    EXPECT_THAT(float_values.values(), ElementsAre(-3, 0, 7, 16777216));
    EXPECT_FALSE(float_values.is_done());
    std::vector<double> doubles(kSampleCount, 4000000000);
    doubles[77] = -0x1p53;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto double_values, ValuesOf(doubles, shard_count));
    EXPECT_THAT(double_values.values(), ElementsAre(-0x1p53, 4000000000));
    std::vector<std::int32_t> wide(kSampleCount, 2000000000);
    wide[77] = -2000000000;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto wide_values, ValuesOf(wide, shard_count));
    EXPECT_THAT(wide_values.values(), ElementsAre(-2000000000, 2000000000));
    std::vector<std::uint16_t> narrow(kSampleCount, 1);
    for (std::size_t i = 0; i < 9; ++i) {
      narrow[i * 1000] = static_cast<std::uint16_t>(65535 - i);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto narrow_values, ValuesOf(narrow, shard_count));
    EXPECT_EQ(narrow_values.values().size(), 10U);
    EXPECT_EQ(narrow_values.values().back(), 65535);
  }
}

// Blocks of one value are not read: their span tells it.
TEST(ShardLabelValuesTest, AVolumeOfOneValueHasThat) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto values,
                                ValuesOf(std::vector<float>(kSampleCount, 5.0F), 2));
  EXPECT_THAT(values.values(), ElementsAre(5));
  const std::vector<double> missing(kSampleCount, std::nan(""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, ValuesOf(missing, 2));
  EXPECT_THAT(none.values(), IsEmpty());
}

TEST(ShardLabelValuesTest, OneFractionMakesAFieldNoLabels) {
  std::vector<double> samples(kSampleCount, 2.0);
  samples[4000] = 0.5;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto values, ValuesOf(samples, 3));
  EXPECT_THAT(values.other_value(), Optional(0.5));
  samples.assign(kSampleCount, 1.25);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto same, ValuesOf(samples, 1));
  EXPECT_THAT(same.other_value(), Optional(1.25));
}

TEST(ShardLabelValuesTest, MoreValuesThanAskedForAreNotListed) {
  std::vector<float> samples(kSampleCount);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i] = static_cast<float>(i % 11);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, ValuesOf(samples, 2, 11));
  EXPECT_FALSE(all.has_more());
  EXPECT_EQ(all.values().size(), 11U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto few, ValuesOf(samples, 2, 10));
  EXPECT_TRUE(few.has_more());
}

TEST(ShardLabelValuesTest, ADamagedBlockAndACancelledCallAreErrors) {
  const testing::SmallDataset dataset(1);
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(LabelValuesOfShards(dataset.OpenShards(), 1000, cancelled),
              StatusIs(absl::StatusCode::kCancelled));
  const Shards shards = dataset.OpenShards();
  testing::FlipBit(dataset.shard_directory(0) + "/" + store::kBlocksFileName, -1);
  EXPECT_THAT(LabelValuesOfShards(shards, 1000, base::Cancellation()),
              StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::agent
