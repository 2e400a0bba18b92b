// An agent's rays must hit the same blocks by sets and by trees: one surface and several, labels,
// translucent surfaces that stop no ray, clip regions, any share of the rays.

#include "partition-agent/frame/occluder_rays.h"

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/store/span_tree_file.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::StatusIs;

class OccluderRaysTest : public ::testing::Test {
 protected:
  OccluderRaysTest() : shards_(dataset_.OpenShards()), task_(dataset_.Request()) {}

  absl::StatusOr<std::vector<volume::BlockId>> Cast(std::int64_t max_dense_blocks) {
    const store::ShardReader& reader = *shards_.front()->reader;
    const view::Clipper clipper(task_.spec.clip, reader.manifest().geometry);
    return CastRays(reader, dataset_.ViewOf(task_), clipper, task_, cancellation_, nullptr,
                    max_dense_blocks);
  }
  // Returns the number of hits.
  std::size_t ExpectEqualHits() {
    const auto by_set = Cast(dataset_.layout().block_count());
    const auto by_tree = Cast(0);
    ISOSCOPE_EXPECT_OK(by_set);
    ISOSCOPE_EXPECT_OK(by_tree);
    EXPECT_EQ(*by_tree, *by_set);
    return by_set->size();
  }

  testing::SmallDataset dataset_{1};
  Shards shards_;
  FrameTask task_;
  base::Cancellation cancellation_;
};

TEST_F(OccluderRaysTest, TreesGiveTheHitsOfSets) {
  EXPECT_GT(ExpectEqualHits(), 5U);
  task_.spec.surfaces.push_back(task_.spec.surfaces.front());
  task_.spec.surfaces.back().rule.isovalue *= 0.8;
  EXPECT_GT(ExpectEqualHits(), 5U);
  task_.agent_count = 3;
  task_.agent_index = 1;
  EXPECT_GT(ExpectEqualHits(), 0U);
  task_.spec.clip.half_spaces.push_back(
      {{1, 0.2, 0}, shards_.front()->reader->manifest().geometry.Bounds().Center().x});
  EXPECT_GT(ExpectEqualHits(), 0U);
}

TEST_F(OccluderRaysTest, TranslucentSurfacesStopNoRay) {
  task_.spec.surfaces.front().opacity = 0.5;
  EXPECT_EQ(ExpectEqualHits(), 0U);
}

TEST_F(OccluderRaysTest, ShardsWithASpanTreeGiveTheSameHits) {
  const auto expected = Cast(0);
  ISOSCOPE_ASSERT_OK(expected);
  const store::ShardReader& reader = *shards_.front()->reader;
  ISOSCOPE_ASSERT_OK(
      store::WriteSpanTree(dataset_.shard_directory(0), reader.manifest(), reader.layout()));
  shards_ = dataset_.OpenShards();
  ASSERT_TRUE(shards_.front()->reader->has_span_tree());
  const auto actual = Cast(0);
  ISOSCOPE_ASSERT_OK(actual);
  EXPECT_EQ(*actual, *expected);
}

TEST_F(OccluderRaysTest, ACancelledFrameEndsWithItsError) {
  cancellation_.Cancel();
  for (const std::int64_t max_dense_blocks : {std::int64_t{0}, volume::kMaxDenseBlocks}) {
    EXPECT_THAT(Cast(max_dense_blocks), StatusIs(absl::StatusCode::kCancelled));
  }
}

}  // namespace
}  // namespace isoscope::agent
