#include "core/partition/stored_samples.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/store/shard_format.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/level_fixture.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::ScalarType;

class StoredSamplesTest : public PartitionerTest {
 protected:
  void SetUp() override {
    PartitionOptions options = Options("dataset");
    options.shard_count = 3;
    options.block_cells = {5, 4, 3};
    ISOSCOPE_ASSERT_OK(Run(volume_, options));
    directories_ = ShardsOf(dir_.Sub("dataset"));
  }

  const math::Index3 dims_{23, 18, 21};
  const Volume volume_{dims_, ScalarType::kInt16, Noise(dims_, ScalarType::kInt16)};
  std::vector<std::string> directories_;
};

TEST_F(StoredSamplesTest, EveryPortionOfAnyPlanHasTheSamplesOfTheVolume) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto samples, StoredSamples::Open(directories_));
  for (const auto& [layers, rows] :
       std::vector<std::pair<std::int64_t, std::int64_t>>{{1, 1}, {1, 3}, {2, 5}, {4, 5}, {7, 5}}) {
    PartitionPlan plan;
    plan.layers_per_portion = layers;
    plan.block_rows_per_portion = rows;
    for (std::int64_t i = 0; i < PortionCount(samples->layout(), plan); ++i) {
      const math::IndexBox box =
          SamplesOfPortion(samples->layout(), PortionAt(samples->layout(), plan, i));
      plan.portion_bytes = std::max(plan.portion_bytes, 2 * math::Volume(box.dims()));
    }
    std::int64_t visited = 0;
    const auto visit = [&](const Slab& slab, const Portion& portion) {
      ++visited;
      const math::IndexBox box = SamplesOfPortion(samples->layout(), portion);
      EXPECT_EQ(slab.begin_z, box.begin.z);
      EXPECT_EQ(slab.begin_y, box.begin.y);
      EXPECT_EQ(slab.rows, box.dims().y);
      const std::string expected = ExpectedBlock(volume_, box);
      EXPECT_TRUE(std::string(slab.samples, expected.size()) == expected) << layers << " " << rows;
      return absl::OkStatus();
    };
    ISOSCOPE_ASSERT_OK(samples->ForEachPortion(plan, visit, never_));
    EXPECT_EQ(visited, PortionCount(samples->layout(), plan));
  }
}

TEST_F(StoredSamplesTest, ErrorsOfBlocksVisitorsAndCancellationsAreReturned) {
  PartitionPlan plan;
  plan.block_rows_per_portion = 5;
  plan.portion_bytes = 1 << 16;
  const auto accept = [](const Slab&, const Portion&) { return absl::OkStatus(); };
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto samples, StoredSamples::Open(directories_));
    EXPECT_THAT(
        samples->ForEachPortion(
            plan, [](const Slab&, const Portion&) { return absl::AbortedError("no"); }, never_),
        StatusIs(absl::StatusCode::kAborted));
    base::Cancellation cancellation;
    cancellation.Cancel();
    EXPECT_THAT(samples->ForEachPortion(plan, accept, cancellation),
                StatusIs(absl::StatusCode::kCancelled));
  }
  const std::string path = directories_[1] + "/blocks.bin";
  std::string bytes = testing::ReadFile(path);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] + 1);
  testing::WriteFile(path, bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto samples, StoredSamples::Open(directories_));
  EXPECT_THAT(samples->ForEachPortion(plan, accept, never_),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block")));
}

TEST_F(StoredSamplesTest, ShardsThatDoNotBelongTogetherAreRefused) {
  std::vector<std::string> swapped = {directories_[1], directories_[0], directories_[2]};
  EXPECT_THAT(StoredSamples::Open(swapped).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("holds shard 1 of 3")));
  directories_.pop_back();
  EXPECT_THAT(StoredSamples::Open(directories_).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("expected shard 0 of 2")));
}

}  // namespace
}  // namespace isoscope::partition
