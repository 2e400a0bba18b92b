#include "core/view/clip_region.h"

#include <cmath>
#include <cstdint>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

volume::GridGeometry Oblique() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {41, 33, 25};
  geometry.spacing = {0.5, 1, 2};
  geometry.origin = {-7, 11, 3};
  geometry.direction.columns = {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.8, 0.6, 0},
                                math::Vec3d{0, 0, 1}};
  return geometry;
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : seed_(seed) {}
  double Uniform(double low, double high) {
    return low + (high - low) * base::RandomUnit(seed_, counter_++);
  }

 private:
  std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

bool IsInWorld(const ClipRegion& region, const math::Vec3d& p) {
  for (const HalfSpace& half_space : region.half_spaces) {
    if (math::Dot(half_space.normal, p) < half_space.offset) {
      return false;
    }
  }
  for (int axis = 0; axis < 3 && region.box; ++axis) {
    if (p[axis] < region.box->min[axis] || p[axis] > region.box->max[axis]) {
      return false;
    }
  }
  return true;
}

TEST(ClipperTest, AnEmptyRegionClipsNothing) {
  EXPECT_TRUE(Clipper().empty());
  EXPECT_TRUE(Clipper(ClipRegion(), Oblique()).empty());
}

TEST(ClipperTest, IndexSpaceAndWorldSpaceAgree) {
  const volume::GridGeometry geometry = Oblique();
  Random random(1);
  for (int i = 0; i < 500; ++i) {
    ClipRegion region;
    region.half_spaces.push_back(
        {{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)},
         random.Uniform(-20, 20)});
    region.box = math::Box3d{{-20, 5, 4}, {random.Uniform(-20, 20), 25, 40}};
    const Clipper clipper(region, geometry);
    ASSERT_EQ(clipper.half_spaces().size(), 7U);
    const math::Vec3f index{static_cast<float>(random.Uniform(0, 40)),
                            static_cast<float>(random.Uniform(0, 32)),
                            static_cast<float>(random.Uniform(0, 24))};
    const math::Vec3d world = math::TransformPoint(
        geometry.world_from_index(),
        {static_cast<double>(index.x), static_cast<double>(index.y), static_cast<double>(index.z)});
    bool is_inside = true;
    for (const HalfSpace& half_space : clipper.half_spaces()) {
      is_inside = is_inside && Clipper::DistanceOf(half_space, index) >= 0;
    }
    EXPECT_EQ(is_inside, IsInWorld(region, world)) << i;
  }
}

TEST(ClipperTest, SidesOfBlocksAreThoseOfAllTheirPoints) {
  const volume::GridGeometry geometry = Oblique();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockLayout layout,
                                volume::BlockLayout::Make(geometry.sample_dims, {8, 8, 8}));
  Random random(2);
  int inside_count = 0;
  int outside_count = 0;
  int cut_count = 0;
  for (int i = 0; i < 200; ++i) {
    ClipRegion region;
    region.half_spaces.push_back(
        {{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)},
         random.Uniform(-20, 20)});
    const Clipper clipper(region, geometry);
    volume::BlockSet shown(layout.block_count());
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      shown.Insert(static_cast<volume::BlockId>(id));
    }
    clipper.EraseOutside(layout, &shown);
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      const auto block = static_cast<volume::BlockId>(id);
      const math::IndexBox cells = layout.CellsOf(block);
      int kept = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const math::Vec3f p{static_cast<float>((corner & 1) != 0 ? cells.end.x : cells.begin.x),
                            static_cast<float>((corner & 2) != 0 ? cells.end.y : cells.begin.y),
                            static_cast<float>((corner & 4) != 0 ? cells.end.z : cells.begin.z)};
        kept += Clipper::DistanceOf(clipper.half_spaces()[0], p) >= 0 ? 1 : 0;
      }
      const Clipper::Side side = clipper.SideOf(layout, block);
      EXPECT_EQ(side, kept == 8   ? Clipper::Side::kInside
                      : kept == 0 ? Clipper::Side::kOutside
                                  : Clipper::Side::kCut);
      EXPECT_EQ(shown.Contains(block), side != Clipper::Side::kOutside);
      inside_count += side == Clipper::Side::kInside ? 1 : 0;
      outside_count += side == Clipper::Side::kOutside ? 1 : 0;
      cut_count += side == Clipper::Side::kCut ? 1 : 0;
    }
  }
  EXPECT_GT(inside_count, 1000);
  EXPECT_GT(outside_count, 1000);
  EXPECT_GT(cut_count, 1000);
}

TEST(ClipperTest, ErasesWhatIsOutsideOfAnyHalfSpaceAndNothingThatWasNotThere) {
  const volume::GridGeometry geometry = Oblique();
  Random random(23);
  for (int i = 0; i < 100; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const volume::BlockLayout layout,
        volume::BlockLayout::Make(geometry.sample_dims, {1 + i % 7, 1 + i % 3, 1 + i % 4}));
    ClipRegion region;
    for (int plane = 0; plane <= i % 3; ++plane) {
      // Some are normal to an axis, and touch the faces of blocks.
      const math::Vec3d normal =
          i % 5 == 0
              ? math::Vec3d{0, 0, 1}
              : math::Vec3d{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)};
      region.half_spaces.push_back({normal, i % 5 == 0 ? 3.0 + 2 * i : random.Uniform(-20, 20)});
    }
    const Clipper clipper(region, geometry);
    volume::BlockSet shown(layout.block_count());
    volume::BlockSet expected(layout.block_count());
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      const auto block = static_cast<volume::BlockId>(id);
      if (random.Uniform(0, 1) < 0.5) {
        continue;
      }
      shown.Insert(block);
      if (clipper.SideOf(layout, block) != Clipper::Side::kOutside) {
        expected.Insert(block);
      }
    }
    clipper.EraseOutside(layout, &shown);
    EXPECT_EQ(shown, expected) << "case " << i;
  }
}

TEST(ClipperTest, ABlockThatTouchesThePlaneIsNotCertain) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {17, 17, 17};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockLayout layout,
                                volume::BlockLayout::Make(geometry.sample_dims, {8, 8, 8}));
  const Clipper clipper({.half_spaces = {{{1, 0, 0}, 8}}, .box = {}}, geometry);
  EXPECT_EQ(clipper.SideOf(layout, layout.IdOf({0, 0, 0})), Clipper::Side::kCut);
  EXPECT_EQ(clipper.SideOf(layout, layout.IdOf({1, 0, 0})), Clipper::Side::kCut);
}

TEST(ClipperTest, AFragmentIsKeptByTheDistanceBetweenItsVertices) {
  EXPECT_TRUE(Clipper::IsKept({-1, 3, 0}, {0.5, 0.25, 0.25}));
  EXPECT_TRUE(Clipper::IsKept({-1, 3, -1}, {0.5, 0.25, 0.25})) << "a distance of 0";
  EXPECT_FALSE(Clipper::IsKept({-1, 1, -1}, {0.5, 0.25, 0.25}));
  EXPECT_TRUE(Clipper::IsKept({0, -1, -1}, {1, 0, 0}));
  EXPECT_FALSE(Clipper::IsKept({1, -2, 0}, {0.5, 0.5, 0}));
}

}  // namespace
}  // namespace isoscope::view
