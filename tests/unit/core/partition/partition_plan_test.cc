#include "core/partition/partition_plan.h"

#include <cstdint>
#include <set>
#include <tuple>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/units.h"
#include "core/volume/block_samples.h"
#include "tests/support/status_matchers.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using store::Distribution;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using volume::ScalarType;

volume::BlockLayout Layout(const math::Index3& dims, const math::Index3& cells = {8, 8, 8}) {
  const auto layout = volume::BlockLayout::Make(dims, cells);
  EXPECT_THAT(layout.status(), testing::IsOk());
  return *layout;
}

TEST(PartitionPlanTest, PortionsCoverEveryBlockOnceAndTheirSamplesFitTheBuffer) {
  for (const math::Index3& dims :
       {math::Index3{40, 70, 90}, {2, 2, 2}, {9, 1000, 3}, {33, 8, 65}}) {
    const auto layout = Layout(dims);
    for (const std::int64_t limit : {1, 30000, 100000, 300000, 1000000, 1 << 30}) {
      const auto plan =
          PlanPartition(layout, ScalarType::kUint16, 1, Distribution::kRandom, 0, limit);
      if (!plan.ok()) {
        continue;
      }
      EXPECT_LE(plan->total_bytes, limit);
      std::set<std::tuple<std::int64_t, std::int64_t>> seen;  // layer, row
      for (std::int64_t i = 0; i < PortionCount(layout, *plan); ++i) {
        const Portion portion = PortionAt(layout, *plan, i);
        for (std::int64_t layer = portion.begin_layer; layer < portion.end_layer; ++layer) {
          for (std::int64_t row = portion.begin_row; row < portion.end_row; ++row) {
            EXPECT_TRUE(seen.emplace(layer, row).second);
          }
        }
        const math::IndexBox box = SamplesOfPortion(layout, portion);
        EXPECT_LE(math::Volume(box.dims()) * 2, plan->portion_bytes);
        EXPECT_EQ(box.dims().x, dims.x);
      }
      EXPECT_EQ(static_cast<std::int64_t>(seen.size()),
                layout.block_dims().y * layout.block_dims().z);
    }
  }
}

TEST(PartitionPlanTest, StoredBytesAreTheSumOfAllBlocks) {
  for (const math::Index3& dims : {math::Index3{40, 70, 90}, {2, 2, 2}, {9, 100, 3}, {33, 8, 65}}) {
    const auto layout = Layout(dims);
    const std::int64_t layers = layout.block_dims().z;
    for (std::int64_t begin = 0; begin < layers; ++begin) {
      for (std::int64_t end = begin + 1; end <= layers; ++end) {
        std::int64_t sum = 0;
        for (std::int64_t i = 0; i < layout.block_count(); ++i) {
          const auto id = static_cast<volume::BlockId>(i);
          if (const std::int64_t z = layout.IndexOf(id).z; begin <= z && z < end) {
            sum +=
                static_cast<std::int64_t>(volume::StoredSizeBytes(layout, id, ScalarType::kUint16));
          }
        }
        EXPECT_EQ(StoredBytes(layout, ScalarType::kUint16, begin, end), sum);
      }
    }
  }
}

TEST(PartitionPlanTest, SmallVolumesTakeFourLayersWhileTheNextAreRead) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto plan,
                                PlanPartition(Layout({512, 512, 512}), ScalarType::kUint16, 4,
                                              Distribution::kRandom, 0, base::kGiB));
  EXPECT_EQ(plan.layers_per_portion, 4);
  EXPECT_TRUE(plan.is_double_buffered);
  EXPECT_LT(plan.total_bytes, 70 * base::kMiB);
}

TEST(PartitionPlanTest, WideSlicesAreTakenInBands) {
  for (const math::Index3& dims :
       {math::Index3{4096, 4096, 64}, {16384, 16384, 9}, {8192, 8192, 20}, {2, 1 << 23, 3}}) {
    const auto layout = Layout(dims);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto plan,
        PlanPartition(layout, ScalarType::kUint16, 8, Distribution::kRandom, 0, 256 * base::kMiB));
    EXPECT_LE(plan.total_bytes, 256 * base::kMiB);
  }
  const auto layout = Layout({4096, 4096, 48});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto plan,
      PlanPartition(layout, ScalarType::kFloat64, 16, Distribution::kRandom, 0, 160 * base::kMiB));
  EXPECT_FALSE(plan.has_whole_planes(layout));
  EXPECT_GT(plan.block_rows_per_portion, 1);
}

TEST(PartitionPlanTest, TheMessageAdvisesWhatHelps) {
  const auto message = [](std::int64_t source_bytes) {
    return std::string(PlanPartition(Layout({100, 100, 60}), ScalarType::kFloat32, 1,
                                     Distribution::kGreedy, source_bytes, 5)
                           .status()
                           .message());
  };
  EXPECT_THAT(message(1000), HasSubstr("reader with its 1000 bytes"));
  EXPECT_THAT(message(1000),
              EndsWith("--memory-limit, or use larger blocks or the random distribution"));
  EXPECT_THAT(message(base::kGiB), EndsWith("; raise --memory-limit"));
}

TEST(PartitionPlanTest, WhatTheMessageAsksForIsEnoughAndNoByteLess) {
  for (const math::Index3& dims : {math::Index3{100, 100, 60}, {5000, 300, 20}}) {
    for (const int shards : {1, 7, 200}) {
      const auto layout = Layout(dims);
      const absl::Status status =
          PlanPartition(layout, ScalarType::kFloat32, shards, Distribution::kRandom, 1000, 5)
              .status();
      ASSERT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("needs ")));
      const std::string message(status.message());
      const std::int64_t needed = std::stoll(message.substr(message.find("needs ") + 6));
      ISOSCOPE_EXPECT_OK(
          PlanPartition(layout, ScalarType::kFloat32, shards, Distribution::kRandom, 1000, needed)
              .status());
      EXPECT_FALSE(PlanPartition(layout, ScalarType::kFloat32, shards, Distribution::kRandom, 1000,
                                 needed - 1)
                       .ok());
    }
  }
}

TEST(PartitionPlanTest, RandomDistributionTakesNoMemoryABlock) {
  // 2^20, 2^26 and 2^29 blocks.
  std::vector<std::int64_t> totals;
  for (const std::int64_t n : {128, 512, 1024}) {
    const auto layout = Layout({n + 1, n + 1, n / 2 + 1}, {1, 1, 1});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto plan,
        PlanPartition(layout, ScalarType::kFloat64, 16, Distribution::kRandom, 0, 80 * base::kMiB));
    totals.push_back(plan.total_bytes);
  }
  // Portions grow with the area of a layer; nothing else grows.
  EXPECT_LT(totals.back() - totals.front(), 80 * base::kMiB);
}

TEST(PartitionPlanTest, GreedyDistributionTakesTheStatedBytesABlock) {
  // 2^25 blocks.
  const auto layout = Layout({8 * 256 + 1, 8 * 256 + 1, 8 * 512 + 1});
  const std::int64_t blocks = layout.block_count();
  ASSERT_EQ(blocks, std::int64_t{1} << 25);
  const std::int64_t limit = (4 + 14) * blocks + 100 * base::kMiB;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto plan, PlanPartition(layout, ScalarType::kUint16, 16,
                                                               Distribution::kGreedy, 0, limit));
  EXPECT_GE(plan.total_bytes, (4 + 14) * blocks);
  EXPECT_LE(plan.total_bytes, limit);
}

TEST(PartitionPlanTest, PositionsAreThoseOfThePortionsOneAfterTheOther) {
  for (const math::Index3& dims :
       {math::Index3{41, 70, 90}, {2, 2, 2}, {9, 1000, 3}, {33, 8, 65}}) {
    const auto layout = Layout(dims);
    const math::Index3& block_dims = layout.block_dims();
    for (const std::int64_t layers : {1, 2, 4}) {
      for (const std::int64_t rows : {std::int64_t{1}, std::int64_t{3}, block_dims.y}) {
        if (layers > 1 && rows < block_dims.y) {
          continue;  // bands are of one layer
        }
        PartitionPlan plan;
        plan.layers_per_portion = layers;
        plan.block_rows_per_portion = rows;
        std::set<std::int64_t> seen;
        std::int64_t portion_begin = 0;
        for (std::int64_t i = 0; i < PortionCount(layout, plan); ++i) {
          const Portion portion = PortionAt(layout, plan, i);
          const std::int64_t count = (portion.end_layer - portion.begin_layer) *
                                     (portion.end_row - portion.begin_row) * block_dims.x;
          for (std::int64_t z = portion.begin_layer; z < portion.end_layer; ++z) {
            for (std::int64_t y = portion.begin_row; y < portion.end_row; ++y) {
              for (std::int64_t x = 0; x < block_dims.x; ++x) {
                const std::int64_t position = PositionInPortions(layout, plan, {x, y, z});
                EXPECT_TRUE(seen.insert(position).second);
                EXPECT_GE(position, portion_begin);
                EXPECT_LT(position, portion_begin + count);
              }
            }
          }
          portion_begin += count;
        }
        EXPECT_EQ(portion_begin, layout.block_count());
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::partition
