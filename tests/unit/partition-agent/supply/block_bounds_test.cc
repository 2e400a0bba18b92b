// Bounds of parts, from the range table of a real shard: any parts add up to the same, and a drawn
// block lies between them. What bounds mean is tested in tests/unit/core/visibility.

#include "partition-agent/supply/block_bounds.h"

#include "gtest/gtest.h"

#include "core/view/clip_region.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using testing::SmallDataset;
using visibility::DepthBounds;

class BlockBoundsTest : public ::testing::Test {
 protected:
  BlockBoundsTest() {
    spec_ = dataset_.Request().spec;
    spec_.viewport = {80, 60};
    spec_.region.reset();
  }

  [[nodiscard]] view::View ViewOf(const frame::FrameSpec& spec) const {
    return view::View::Make(*spec.camera, spec.viewport, dataset_.geometry(), spec.region).value();
  }
  absl::StatusOr<DepthBounds> Find(const frame::FrameSpec& spec, const BlockPart& part) {
    return BoundsOfPart(*shards_.front()->reader, ViewOf(spec), spec, part, &arena_, cancellation_,
                        max_dense_blocks_);
  }
  DepthBounds FindAll(const frame::FrameSpec& spec, int part_count) {
    DepthBounds all(spec.viewport.width_px, spec.viewport.height_px);
    for (int i = part_count - 1; i >= 0; --i) {
      all.UniteWith(Find(spec, {i, part_count}).value());
    }
    return all;
  }

  const SmallDataset dataset_{2};
  const Shards shards_ = dataset_.OpenShards();
  base::TaskArena arena_{2};
  base::Cancellation cancellation_;
  frame::FrameSpec spec_;
  std::int64_t max_dense_blocks_ = volume::kMaxDenseBlocks;
};

TEST_F(BlockBoundsTest, AnyNumberOfPartsGivesTheSame) {
  spec_.clip.half_spaces = {{{1, 0, 0}, 12}};
  spec_.caps.emplace();
  const DepthBounds expected = FindAll(spec_, 1);
  EXPECT_NE(expected, DepthBounds(80, 60));
  for (const int part_count : {2, 7, 1000}) {
    EXPECT_EQ(FindAll(spec_, part_count), expected) << part_count << " parts";
  }
}

TEST_F(BlockBoundsTest, TreesOfALargeVolumeGiveTheSame) {
  spec_.surfaces.push_back(spec_.surfaces[0]);
  spec_.surfaces[1].rule.isovalue = 60;
  spec_.clip.half_spaces = {{{1, 0.2, 0.1}, 14}};
  spec_.caps.emplace();
  const DepthBounds expected = FindAll(spec_, 1);
  EXPECT_NE(expected, DepthBounds(80, 60));
  max_dense_blocks_ = 0;
  for (const int part_count : {1, 3, 100}) {
    EXPECT_EQ(FindAll(spec_, part_count), expected) << part_count << " parts";
  }
}

TEST_F(BlockBoundsTest, AnyShardHasThemForAllBlocks) {
  const store::ShardReader& other = *shards_.back()->reader;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const DepthBounds of_other,
      BoundsOfPart(other, ViewOf(spec_), spec_, {}, &arena_, cancellation_));
  EXPECT_EQ(of_other, FindAll(spec_, 1));
}

TEST_F(BlockBoundsTest, MoreSurfacesWidenThem) {
  spec_.surfaces[0].rule.isovalue = 150;
  const DepthBounds one = FindAll(spec_, 1);
  frame::FrameSpec other = spec_;
  other.surfaces[0].rule.isovalue = 60;
  DepthBounds expected = FindAll(other, 1);
  expected.UniteWith(one);
  spec_.surfaces.push_back(other.surfaces[0]);
  spec_.surfaces[1].opacity = 0.5F;
  EXPECT_EQ(FindAll(spec_, 1), expected);
}

TEST_F(BlockBoundsTest, CapsWidenThemOnlyWhereTheRegionIsCut) {
  spec_.surfaces[0].rule.isovalue = 20;  // some blocks are wholly inside
  const DepthBounds open = FindAll(spec_, 1);
  spec_.caps.emplace();
  EXPECT_EQ(FindAll(spec_, 1), open) << "nothing is cut";
  spec_.clip.half_spaces = {{{1, 0, 0}, 12}};
  const DepthBounds capped = FindAll(spec_, 1);
  spec_.caps.reset();
  DepthBounds cut = FindAll(spec_, 1);
  EXPECT_NE(capped, cut);
  cut.UniteWith(capped);
  EXPECT_EQ(capped, cut) << "they only widen";
}

TEST_F(BlockBoundsTest, ACancelledQuestionEnds) {
  cancellation_.Cancel();
  EXPECT_TRUE(absl::IsCancelled(Find(spec_, {}).status()));
}

}  // namespace
}  // namespace isoscope::agent
