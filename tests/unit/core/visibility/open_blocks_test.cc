// Going down the cubes must find what a test of each block finds: random volumes and pictures, the
// eye inside and outside, both projections, regions, clip planes, both kinds of maps, skipped blocks.

#include "core/visibility/open_blocks.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::visibility {
namespace {

using volume::BlockId;
using volume::BlockLayout;
using volume::BlockSet;
using volume::BlockTree;

// The test of each block.
std::vector<BlockId> OneByOne(const view::View& view, const BlockLayout& layout,
                              const view::Clipper& clipper, const OcclusionMap& map,
                              const std::vector<BlockId>& ids) {
  std::vector<BlockId> open;
  for (const BlockId id : ids) {
    const view::Footprint footprint = view.FootprintOf(layout, id);
    if (!footprint.rect.empty() && !map.Hides(footprint) &&
        (clipper.empty() || clipper.SideOf(layout, id) != view::Clipper::Side::kOutside)) {
      open.push_back(id);
    }
  }
  return open;
}

// A picture whose depths vary slowly, with a few holes; some of it is missing.
image::FrameImage RandomImage(const view::Viewport& size, std::uint64_t seed) {
  image::FrameImage image(size.width_px, size.height_px);
  const double middle = base::RandomUnit(seed, 0);
  const double holes = base::RandomUnit(seed, 1) < 0.5 ? 0.0 : 0.002;
  const double width = base::RandomUnit(seed, 2) * 2 * size.width_px;
  for (int y = 0; y < size.height_px; ++y) {
    for (int x = 0; x < std::min<int>(size.width_px, static_cast<int>(width)); ++x) {
      const std::size_t i = image.IndexOf(x, y);
      if (base::RandomUnit(seed + 1, i) >= holes) {
        const auto depth = static_cast<float>(
            std::clamp(middle + 0.1 * std::sin(0.05 * x) * std::cos(0.04 * y), 0.0, 1.0));
        image.Set(x, y, image::FragmentKey(depth, 1), {});
      }
    }
  }
  return image;
}

TEST(BlockCubesTest, FindTheBlocksThatATestOfEachFinds) {
  std::size_t open_count = 0;
  std::size_t hidden_count = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    std::uint64_t counter = 0;
    const auto random = [&](double begin, double end) {
      return begin + base::RandomUnit(500 + seed, counter++) * (end - begin);
    };
    volume::GridGeometry geometry;
    geometry.spacing = {1, random(0.3, 2), random(0.3, 2)};
    geometry.origin = {random(-1e3, 1e3), 7, -3};
    math::Index3 cells;
    for (int axis = 0; axis < 3; ++axis) {
      geometry.sample_dims[axis] = static_cast<std::int64_t>(random(2, 60));
      cells[axis] = static_cast<std::int64_t>(random(1, 5));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                  BlockLayout::Make(geometry.sample_dims, cells));
    view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
    if (seed % 3 != 0) {
      view::Azimuth(random(-4, 4), &camera);
      view::Elevation(random(-1.4, 1.4), &camera);
      view::OrthogonalizeUp(&camera);
    }
    if (random(0, 1) < 0.4) {
      camera.projection = view::Projection::kOrthographic;
    } else if (random(0, 1) < 0.5) {  // in the volume
      camera.eye = camera.target + (camera.eye - camera.target) * random(0.01, 0.3);
    }
    const view::Viewport viewport{static_cast<int>(random(1, 300)),
                                  static_cast<int>(random(1, 300))};
    std::optional<view::Region> region;
    if (random(0, 1) < 0.3) {
      region = view::Region{viewport.width_px / 3, viewport.height_px / 4,
                            1 + viewport.width_px / 2, 1 + viewport.height_px / 3};
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                  view::View::Make(camera, viewport, geometry, region));
    view::ClipRegion clip;
    if (random(0, 1) < 0.3) {
      clip.half_spaces.push_back({{random(-1, 1), random(-1, 1), 0.3}, random(-20, 20)});
    }
    const view::Clipper clipper(clip, geometry);

    BlockSet set(layout.block_count());
    const double share = random(0, 1) < 0.5 ? 0.02 : 0.5;
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      if (base::RandomUnit(seed, static_cast<std::uint64_t>(id)) < share) {
        set.Insert(static_cast<BlockId>(id));
      }
    }
    const BlockTree tree(layout.block_dims(), set);
    const BlockCubes cubes(tree);
    const OcclusionMap map = OcclusionMap::FromImage(
        RandomImage(view.image_size(), seed), seed % 5 == 0 ? MapKind::kMask : MapKind::kDepth);
    const std::vector<std::uint64_t> marks = cubes.OpenBlocks(view, layout, clipper, map, {});
    const std::vector<BlockId> expected = OneByOne(view, layout, clipper, map, set.Ids());
    ASSERT_EQ(tree.IdsOf(marks), expected) << "seed " << seed;
    open_count += expected.size();
    hidden_count += static_cast<std::size_t>(set.Count()) - expected.size();

    // Some of the members are drawn already.
    std::vector<std::uint64_t> skipped(tree.words().begin(), tree.words().end());
    for (std::size_t i = 0; i < skipped.size(); ++i) {
      skipped[i] &= base::RandomBits(seed, i);
    }
    std::vector<std::uint64_t> others = marks;
    for (std::size_t i = 0; i < others.size(); ++i) {
      others[i] &= ~skipped[i];
    }
    ASSERT_EQ(cubes.OpenBlocks(view, layout, clipper, map, skipped), others) << "seed " << seed;
  }
  EXPECT_GT(open_count, 10000U);
  EXPECT_GT(hidden_count, 10000U);
}

TEST(BlockCubesTest, TheMapOfCullingNoneLeavesAllBlocksInViewOpen) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {33, 33, 33};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                BlockLayout::Make(geometry.sample_dims, {4, 4, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::View view,
      view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), {64, 64}, geometry));
  BlockSet set(layout.block_count());
  set.InsertAll({0, 63, 200, 511});
  const BlockTree tree(layout.block_dims(), set);
  EXPECT_EQ(BlockCubes(tree).OpenBlocks(view, layout, {}, OcclusionMap(), {}),
            std::vector<std::uint64_t>(tree.words().begin(), tree.words().end()));
  const BlockTree empty(layout.block_dims(), BlockSet(layout.block_count()));
  EXPECT_TRUE(BlockCubes(empty).OpenBlocks(view, layout, {}, OcclusionMap(), {}).empty());
}

}  // namespace
}  // namespace isoscope::visibility
