#include "server/frame/reduction.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/task_arena.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/frame/frame_pieces.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::ElementsAreArray;

// By sets, and by trees: the largest volume whose blocks are kept as sets.
class ReductionTest : public ::testing::TestWithParam<std::int64_t> {
 protected:
  ReductionTest() { spec_.surfaces.resize(1); }

  // A frame of three parts with these active blocks.
  Reduction Make(const std::vector<Blocks>& hits) {
    Reduction reduction({.spec = &spec_,
                         .view = &view_,
                         .layout = &layout_,
                         .active = nullptr,
                         .images = images_.get(),
                         .arena = &arena_,
                         .keeps_blocks = keeps_blocks_,
                         .max_dense_blocks = GetParam()},
                        active_.size(), images_->Take(kWidth, kHeight));
    for (std::size_t i = 0; i < active_.size(); ++i) {
      reduction.AddRayHits(i, hits[i], active_[i]);
    }
    reduction.SelectOccluders([](std::size_t, Reduction::PartBlocks*) {});
    return reduction;
  }

  const view::View view_ = MakeView();
  const volume::BlockLayout layout_ = *volume::BlockLayout::Make(kDims, {4, 4, 4});
  const std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  base::TaskArena arena_{2};
  frame::FrameSpec spec_;
  bool keeps_blocks_ = false;
  std::vector<Blocks> active_ = {Every(3, 0), Every(3, 1), Every(3, 2)};
};

INSTANTIATE_TEST_SUITE_P(SetsAndTrees, ReductionTest,
                         ::testing::Values(volume::kMaxDenseBlocks, std::int64_t{0}),
                         [](const auto& test) {
                           return test.param == 0 ? std::string("Trees") : std::string("Sets");
                         });

// An active block is occluding if it is a hit or touches one. Invisible blocks outside of the
// picture are not sent.
TEST_P(ReductionTest, EveryPartGetsItsOwnOfTheOccludingBlocks) {
  active_ = {Every(5, 0), Every(5, 2), Every(5, 3)};
  Reduction reduction = Make({{2, 5, 63}, {}, {5, 40}});
  std::size_t occluding_count = 0;
  std::size_t unsent_count = 0;
  for (std::size_t i = 0; i < active_.size(); ++i) {
    Blocks expected;
    for (const volume::BlockId id : active_[i]) {
      const math::Index3 at = layout_.IndexOf(id);
      for (const volume::BlockId hit : {2U, 5U, 40U, 63U}) {
        const math::Index3 of_hit = layout_.IndexOf(hit);
        if (std::abs(at.x - of_hit.x) <= 1 && std::abs(at.y - of_hit.y) <= 1 &&
            std::abs(at.z - of_hit.z) <= 1) {
          if (view_.FootprintOf(layout_, id).rect.empty()) {
            ++unsent_count;
          } else {
            expected.push_back(id);
          }
          break;
        }
      }
    }
    EXPECT_EQ(reduction.BlocksOf(i)->occluders, expected) << i;
    occluding_count += expected.size();
  }
  EXPECT_GT(occluding_count, 3U);
  EXPECT_GT(unsent_count, 3U);
  EXPECT_THAT(reduction.ray_hits().Ids(), ElementsAre(2, 5, 40, 63));
  const ReducedFrame reduced = reduction.Take();
  EXPECT_EQ(reduced.ray_hit_block_count, 4);
  ASSERT_NE(reduced.active, nullptr);
  for (std::size_t i = 0; i < active_.size(); ++i) {
    const auto begin = reduced.active->ids.begin();
    const std::vector<std::size_t>& begins = reduced.active->begin_by_agent;
    EXPECT_THAT(Blocks(begin + static_cast<std::ptrdiff_t>(begins[i]),
                       begin + static_cast<std::ptrdiff_t>(begins[i + 1])),
                ElementsAreArray(active_[i]));
  }
}

TEST_P(ReductionTest, BlocksAreKeptForTheNextBandIfTheyAreAskedFor) {
  for (const bool keeps : {false, true}) {
    keeps_blocks_ = keeps;
    Reduction reduction = Make({{21}, {}, {}});
    for (const std::string& band : ShuffledBands(Wall(), 1)) {
      ISOSCOPE_ASSERT_OK(reduction.CompositeBand(band));
    }
    reduction.SelectVisible([](std::size_t, Reduction::PartBlocks*) {});
    std::vector<PartBlocks> told;
    for (std::size_t i = 0; i < active_.size(); ++i) {
      told.push_back(*reduction.BlocksOf(i));
    }
    const ReducedFrame reduced = reduction.Take();
    ASSERT_EQ(reduced.blocks.size(), keeps ? active_.size() : 0U);
    EXPECT_EQ(reduced.ray_hit_block_count, 1);
    if (!keeps) {
      continue;
    }
    EXPECT_THAT(reduced.ray_hits.Ids(), ElementsAre(21));
    std::size_t count = 0;
    for (std::size_t i = 0; i < told.size(); ++i) {
      EXPECT_EQ(reduced.blocks[i].occluders, told[i].occluders);
      EXPECT_EQ(reduced.blocks[i].visible, told[i].visible);
      EXPECT_TRUE(reduced.blocks[i].open_pixels.empty());
      count += told[i].occluders.size() + told[i].visible.size();
    }
    EXPECT_GT(count, 0U);
  }
}

TEST_P(ReductionTest, EveryPartGetsItsOwnOtherBlocksAndWhatPixelsTheyCanWin) {
  for (const auto culling : {frame::Culling::kDepth, frame::Culling::kMask}) {
    const bool is_depth = culling == frame::Culling::kDepth;
    SCOPED_TRACE(is_depth ? "depth" : "mask");
    spec_.culling = culling;
    Reduction reduction = Make({{21}, {}, {}});
    for (const std::string& band : ShuffledBands(Wall(), 1)) {
      ISOSCOPE_ASSERT_OK(reduction.CompositeBand(band));
    }
    reduction.SelectVisible([](std::size_t, Reduction::PartBlocks*) {});
    const auto map = visibility::OcclusionMap::FromImage(
        Wall(), is_depth ? visibility::MapKind::kDepth : visibility::MapKind::kMask);
    std::size_t hidden_count = 0;
    std::size_t off_screen_count = 0;
    std::size_t visible_count = 0;
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const Reduction::PartBlocks& part = *reduction.BlocksOf(i);
      Blocks expected;
      std::vector<image::PixelMask> masks;
      for (const volume::BlockId id : active_[i]) {
        if (std::binary_search(part.occluders.begin(), part.occluders.end(), id)) {
          continue;
        }
        const view::Footprint footprint = view_.FootprintOf(layout_, id);
        if (footprint.rect.empty()) {
          ++off_screen_count;
        } else if (map.Hides(footprint)) {
          ++hidden_count;
        } else {
          expected.push_back(id);
          masks.push_back(map.OpenPixels(footprint));
        }
      }
      visible_count += expected.size();
      EXPECT_EQ(part.visible, expected);
      // The paper's mask says nothing of pixels.
      EXPECT_TRUE(part.open_pixels ==
                  (is_depth ? visibility::EncodeOpenPixels(masks) : std::string()));
    }
    // The scene shows all three fates, or the test says nothing.
    EXPECT_GT(visible_count, 0U);
    EXPECT_GT(hidden_count, 0U);
    EXPECT_GT(off_screen_count, 0U);
  }
}

TEST_P(ReductionTest, BlocksThatAreWhollyClippedAreNeverDrawn) {
  spec_.clip.half_spaces.push_back({{1, 0, 0}, view_.geometry().Bounds().Center().x});
  const view::Clipper clipper(spec_.clip, view_.geometry());
  Reduction reduction = Make({{21}, {22}, {}});
  reduction.SelectVisible([](std::size_t, Reduction::PartBlocks*) {});
  std::size_t drawn_count = 0;
  for (std::size_t i = 0; i < active_.size(); ++i) {
    const Reduction::PartBlocks& part = *reduction.BlocksOf(i);
    for (const Blocks& blocks : {part.occluders, part.visible}) {
      drawn_count += blocks.size();
      for (const volume::BlockId id : blocks) {
        EXPECT_NE(clipper.SideOf(layout_, id), view::Clipper::Side::kOutside) << id;
      }
    }
  }
  EXPECT_GT(drawn_count, 0U);
}

TEST_P(ReductionTest, AnImageOfAnotherSizeIsRefused) {
  const Reduction reduction = Make({{}, {}, {}});
  ISOSCOPE_EXPECT_OK(reduction.CheckSize({.image = Wall(), .layers = {}, .memory = nullptr}));
  EXPECT_THAT(
      reduction.CheckSize({.image = image::FrameImage(kWidth, 3), .layers = {}, .memory = nullptr}),
      StatusIs(absl::StatusCode::kInternal, "drew 37 x 3 pixels of 37 x 29"));
}

}  // namespace
}  // namespace isoscope::server
