#include "server/frame/drawn_blocks.h"

#include <memory>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/unit/server/frame/frame_pieces.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Part 0 has the even blocks, part 1 the odd ones.
std::shared_ptr<const ActiveBlocks> Active() {
  return std::make_shared<const ActiveBlocks>(std::vector<Blocks>{Every(2, 0), Every(2, 1)},
                                              *volume::BlockLayout::Make(kDims, {4, 4, 4}));
}

ReducedFrame BandOf(const Blocks& hits, std::vector<PartBlocks> blocks) {
  ReducedFrame band;
  band.active = Active();
  band.ray_hits = volume::BlockSet(kBlockCount, hits);
  band.blocks = std::move(blocks);
  return band;
}

FramePart PartOf(int shard) {
  FramePart part;
  part.shard_indices = {shard};
  return part;
}

frame::AgentStatistics AgentOf(int shard, std::int64_t triangles) {
  frame::AgentStatistics agent;
  agent.shard_indices = {shard};
  agent.active_block_count = 32;
  agent.triangle_count = triangles;
  agent.unique_vertex_count = triangles / 2;
  agent.surfaces = {{.triangle_count = triangles, .unique_vertex_count = triangles / 2}};
  agent.read_bytes = 1000;
  agent.index_page_read_count = 3;
  agent.busy_duration = absl::Milliseconds(5);
  return agent;
}

FrameCost CostOfBand(std::int64_t triangles) {
  FrameResult result;
  result.agents = {AgentOf(0, triangles), AgentOf(1, 10 * triangles)};
  result.network_bytes = 70;
  result.occluder_rendering_duration = absl::Milliseconds(2);
  FrameCost cost = CostOf(result);
  cost.truncated_pixel_count = 4;
  cost.encode = absl::Milliseconds(1);
  return cost;
}

TEST(DrawnBlocksTest, NothingIsCountedBeforeTheFirstBand) {
  const DrawnBlocks drawn(kBlockCount);
  EXPECT_THAT(drawn.OpaqueOf(0), IsEmpty());
  EXPECT_THAT(drawn.TranslucentOf(1), IsEmpty());
  FrameCost cost = CostOfBand(1);
  cost.total.visible_block_count = 9;
  drawn.SetCounts({PartOf(0), PartOf(1)}, &cost);
  EXPECT_EQ(cost.total.visible_block_count, 9) << "as the agents say, without culling";
}

TEST(DrawnBlocksTest, EachPartGetsItsBlocksOfAllBandsOnce) {
  DrawnBlocks drawn(kBlockCount);
  drawn.Add(BandOf({4, 7}, {{.occluders = {4}, .visible = {6}}, {.occluders = {7}}}));
  drawn.Add(BandOf({4, 9}, {{.occluders = {4, 6}, .visible = {8}}, {.visible = {7, 9}}}));
  EXPECT_THAT(drawn.OpaqueOf(0), ElementsAre(4, 6, 8));
  EXPECT_THAT(drawn.OpaqueOf(1), ElementsAre(7, 9));
  // Step 2 draws no translucent surface.
  EXPECT_THAT(drawn.TranslucentOf(0), ElementsAre(6, 8));
  EXPECT_THAT(drawn.TranslucentOf(1), ElementsAre(7, 9));
}

TEST(DrawnBlocksTest, CountsAreOfDistinctBlocksAndBelongToTheirAgents) {
  DrawnBlocks drawn(kBlockCount);
  drawn.Add(BandOf({4, 7}, {{.occluders = {4}, .visible = {6}}, {.occluders = {7}}}));
  drawn.Add(BandOf({4, 9}, {{.occluders = {4, 6}, .visible = {8}}, {.visible = {7, 9}}}));
  FrameCost cost = CostOfBand(1);
  // The parts may be in another order than the agents.
  std::swap(cost.agents[0], cost.agents[1]);
  drawn.SetCounts({PartOf(0), PartOf(1)}, &cost);
  EXPECT_EQ(cost.ray_hit_block_count, 3);
  EXPECT_EQ(cost.total.occluding_block_count, 3);
  EXPECT_EQ(cost.total.visible_block_count, 5);
  EXPECT_EQ(cost.agents[1].occluding_block_count, 2);
  EXPECT_EQ(cost.agents[1].visible_block_count, 3);
  EXPECT_EQ(cost.agents[0].occluding_block_count, 1);
  EXPECT_EQ(cost.agents[0].visible_block_count, 2);
}

TEST(DrawnBlocksTest, CostsOfBandsAddUpButActiveBlocksDoNot) {
  FrameCost cost = CostOfBand(100);
  AddBand(CostOfBand(8), /*has_surface=*/true, &cost);
  AddBand(CostOfBand(100), /*has_surface=*/false, &cost);
  EXPECT_EQ(cost.total.triangle_count, 11 * 108);
  EXPECT_EQ(cost.total.surfaces[0].triangle_count, 11 * 108);
  EXPECT_EQ(cost.agents[1].unique_vertex_count, 10 * 108 / 2);
  EXPECT_EQ(cost.total.active_block_count, 64);
  EXPECT_EQ(cost.agents[0].active_block_count, 32);
  EXPECT_EQ(cost.total.read_bytes, 6000);
  EXPECT_EQ(cost.agents[0].index_page_read_count, 9);
  EXPECT_EQ(cost.agents[0].busy_duration, absl::Milliseconds(15));
  EXPECT_EQ(cost.network_bytes, 210);
  EXPECT_EQ(cost.truncated_pixel_count, 12);
  EXPECT_EQ(cost.occluder_rendering, absl::Milliseconds(6));
  EXPECT_EQ(cost.encode, absl::Milliseconds(3));
}

TEST(DrawnBlocksTest, ItsBytesAreThoseOfItsSets) {
  EXPECT_EQ(DrawnBlocks::BytesOf(64), std::size_t{4} * 8);
  EXPECT_EQ(DrawnBlocks::BytesOf(65), std::size_t{4} * 16);
}

}  // namespace
}  // namespace isoscope::server
