// Lists of active blocks are compared with the range table: with sets, as in small volumes, and
// without, as in large ones; of isovalues and labels; clipped or not.

#include "partition-agent/supply/surface_blocks.h"

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "gtest/gtest.h"

#include "core/view/clip_region.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using testing::SmallDataset;
using volume::InsideRule;

class SurfaceBlocksTest : public ::testing::Test {
 protected:
  absl::StatusOr<SurfaceBlocks> Find(const std::vector<InsideRule>& rules,
                                     std::int64_t max_dense_blocks) {
    IndexCost cost;
    return SurfaceBlocks::Find(shards_, rules, nullptr, never_, &cost, max_dense_blocks);
  }
  // The blocks that a surface meets and that are not wholly clipped.
  std::vector<volume::BlockId> Expected(const std::vector<InsideRule>& rules,
                                        const view::Clipper& clipper) {
    const store::ShardReader& reader = *shards_.front()->reader;
    std::vector<volume::BlockId> expected;
    for (std::int64_t i = 0; i < reader.layout().block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      bool is_active = false;
      for (const InsideRule& rule : rules) {
        is_active = is_active || rule.IsActive(reader.ranges().Get(id));
      }
      if (is_active && clipper.SideOf(reader.layout(), id) != view::Clipper::Side::kOutside) {
        expected.push_back(id);
      }
    }
    return expected;
  }

  const SmallDataset dataset_{2};
  const Shards shards_ = dataset_.OpenShards();
  const base::Cancellation never_;
};

TEST_F(SurfaceBlocksTest, TheyAreThoseOfTheRangeTableWithSetsAndWithout) {
  const view::Clipper all({}, dataset_.geometry());
  const view::Clipper cut({.half_spaces = {{{1, 0.3, 0}, 20}}, .box = {}}, dataset_.geometry());
  const std::vector<std::vector<InsideRule>> surfaces = {
      {InsideRule::OfIsovalue(SmallDataset::kIsovalue)},
      {InsideRule::OfLabels({100, 128})},
      {InsideRule::OfIsovalue(60), InsideRule::OfIsovalue(180), InsideRule::OfLabels({90})}};
  for (const std::vector<InsideRule>& rules : surfaces) {
    for (const std::int64_t max_dense_blocks : {volume::kMaxDenseBlocks, std::int64_t{0}}) {
      for (const view::Clipper* const clipper : {&all, &cut}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(SurfaceBlocks blocks, Find(rules, max_dense_blocks));
        blocks.EraseOutside(*clipper);
        const std::vector<volume::BlockId> expected = Expected(rules, *clipper);
        EXPECT_GT(expected.size(), 10U);
        EXPECT_EQ(blocks.Ids(), expected);
        EXPECT_EQ(blocks.block_count(), static_cast<std::int64_t>(expected.size()));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<ChosenMesh> chosen,
                                      blocks.Choose(expected));
        EXPECT_EQ(chosen.size(), blocks.ChooseAll().size());
        EXPECT_GE(chosen.size(), expected.size());
      }
    }
  }
}

TEST_F(SurfaceBlocksTest, ABlockThatIsClippedCannotBeChosen) {
  const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(SmallDataset::kIsovalue)};
  const view::Clipper cut({.half_spaces = {{{1, 0, 0}, 20}}, .box = {}}, dataset_.geometry());
  for (const std::int64_t max_dense_blocks : {volume::kMaxDenseBlocks, std::int64_t{0}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(SurfaceBlocks blocks, Find(rules, max_dense_blocks));
    const std::vector<volume::BlockId> before = blocks.Ids();
    blocks.EraseOutside(cut);
    EXPECT_LT(blocks.Ids().size(), before.size());
    EXPECT_TRUE(absl::IsInvalidArgument(blocks.Choose(before).status()));
  }
}

}  // namespace
}  // namespace isoscope::agent
