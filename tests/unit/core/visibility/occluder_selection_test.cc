#include "core/visibility/occluder_selection.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::visibility {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using volume::BlockId;
using volume::BlockLayout;
using volume::BlockSet;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Scene {
  view::View view;
  BlockLayout layout;
};

Scene MakeScene(const view::Camera& camera, const math::Index3& samples,
                const math::Index3& block_cells, view::Viewport viewport = {64, 48}) {
  volume::GridGeometry geometry;
  geometry.sample_dims = samples;
  geometry.spacing = {1, 1.5, 0.75};
  geometry.origin = {4, -20, 7};
  auto view = view::View::Make(camera, viewport, geometry);
  auto layout = BlockLayout::Make(samples, block_cells);
  ISOSCOPE_EXPECT_OK(view);
  ISOSCOPE_EXPECT_OK(layout);
  return {*std::move(view), *std::move(layout)};
}

math::Box3d BoundsOf(const math::Index3& samples) {
  volume::GridGeometry geometry;
  geometry.sample_dims = samples;
  geometry.spacing = {1, 1.5, 0.75};
  geometry.origin = {4, -20, 7};
  return geometry.Bounds();
}

BlockSet RandomBlocks(const BlockLayout& layout, double share, std::uint64_t seed) {
  BlockSet active(layout.block_count());
  for (std::int64_t id = 0; id < layout.block_count(); ++id) {
    if (base::RandomUnit(seed, static_cast<std::uint64_t>(id)) < share) {
      active.Insert(static_cast<BlockId>(id));
    }
  }
  return active;
}

// Where the ray enters the block's box grown by `grow` (infinity: it misses it).
double EntryOf(const Ray& ray, const BlockLayout& layout, BlockId id, double grow) {
  const math::IndexBox cells = layout.CellsOf(id);
  double enter = 0;
  double exit = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = static_cast<double>(cells.begin[axis]) - grow;
    const double high = static_cast<double>(cells.end[axis]) + grow;
    if (ray.direction[axis] == 0) {
      if (ray.origin[axis] < low || ray.origin[axis] > high) {
        return kInfinity;
      }
      continue;
    }
    const double a = (low - ray.origin[axis]) / ray.direction[axis];
    const double b = (high - ray.origin[axis]) / ray.direction[axis];
    enter = std::max(enter, std::min(a, b));
    exit = std::min(exit, std::max(a, b));
  }
  return enter <= exit ? enter : kInfinity;
}

// By looking at every block: the ray must stop at the first active one, up to rounding on edges
// that it touches but does not cross. Returns the number of rays that hit something.
int ExpectFirstBlocks(const Scene& scene, const RaySet& rays, const BlockSet& active,
                      std::int64_t stride) {
  constexpr double kEdge = 1e-7;  // cells
  int hit_count = 0;
  for (std::int64_t number = 0; number < rays.count(); number += stride) {
    const std::vector<BlockId> hits = rays.Cast(number, number + 1, active);
    const std::optional<Ray> ray = rays.RayOf(number);
    if (!ray.has_value()) {
      EXPECT_THAT(hits, IsEmpty());
      continue;
    }
    double first_surely = kInfinity;   // of blocks that the ray certainly crosses
    double first_perhaps = kInfinity;  // of blocks that it at least nearly touches
    for (std::int64_t id = 0; id < scene.layout.block_count(); ++id) {
      const auto block = static_cast<BlockId>(id);
      if (active.Contains(block)) {
        first_surely = std::min(first_surely, EntryOf(*ray, scene.layout, block, -kEdge));
        first_perhaps = std::min(first_perhaps, EntryOf(*ray, scene.layout, block, kEdge));
      }
    }
    EXPECT_LE(hits.size(), 1U);
    if (hits.empty()) {
      EXPECT_EQ(first_surely, kInfinity) << "ray " << number;
      continue;
    }
    ++hit_count;
    EXPECT_TRUE(active.Contains(hits[0]));
    const double entry = EntryOf(*ray, scene.layout, hits[0], kEdge);
    EXPECT_NE(entry, kInfinity) << "ray " << number;
    EXPECT_LE(entry, first_surely) << "ray " << number;
    EXPECT_GE(entry, first_perhaps) << "ray " << number;
  }
  return hit_count;
}

TEST(RaySetTest, ARayStopsAtTheFirstActiveBlock) {
  const math::Index3 samples{41, 30, 35};  // the last block of each axis is smaller
  for (int i = 0; i < 8; ++i) {
    view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
    view::Azimuth(0.4 * i, &camera);
    view::Elevation(0.3 * i - 1, &camera);
    view::OrthogonalizeUp(&camera);
    if (i % 2 == 1) {
      camera.projection = view::Projection::kOrthographic;
    }
    if (i >= 4) {  // the eye inside the volume
      camera.eye = camera.target + (camera.eye - camera.target) * 0.05;
    }
    const Scene scene = MakeScene(camera, samples, {8, 7, 9});
    const RaySet rays(scene.view, scene.layout, 42);
    const BlockSet active =
        RandomBlocks(scene.layout, i % 3 == 0 ? 0.1 : 0.4, static_cast<std::uint64_t>(i));
    EXPECT_GT(ExpectFirstBlocks(scene, rays, active, 1), 20) << "view " << i;
  }
}

TEST(RaySetTest, AxisParallelRaysAndRaysAlongFacesArriveToo) {
  const math::Index3 samples{33, 33, 33};
  view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  for (const view::Projection projection :
       {view::Projection::kOrthographic, view::Projection::kPerspective}) {
    camera.projection = projection;
    const Scene scene = MakeScene(camera, samples, {8, 8, 8});
    const RaySet rays(scene.view, scene.layout, 1);
    EXPECT_GT(ExpectFirstBlocks(scene, rays, RandomBlocks(scene.layout, 0.1, 5), 1), 100);
  }
  // The eye on a corner of the volume, looking along an edge.
  camera.projection = view::Projection::kPerspective;
  camera.eye = BoundsOf(samples).max;
  camera.target = camera.eye - math::Vec3d{0, 0, 1};
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 1);
  EXPECT_GT(ExpectFirstBlocks(scene, rays, RandomBlocks(scene.layout, 0.8, 5), 1), 10);
}

TEST(RaySetTest, FlatVolumesAreMet) {
  for (const math::Index3& samples :
       {math::Index3{40, 40, 2}, math::Index3{2, 40, 40}, math::Index3{2, 2, 2}}) {
    view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
    view::Azimuth(0.5, &camera);
    const Scene scene = MakeScene(camera, samples, {8, 8, 8});
    const RaySet rays(scene.view, scene.layout, 1);
    const BlockSet active = RandomBlocks(scene.layout, 1.0, 1);
    EXPECT_GT(ExpectFirstBlocks(scene, rays, active, 1), 0);
    // From this side every block of a sheet one block thick is in view.
    EXPECT_EQ(static_cast<std::int64_t>(rays.Cast(0, rays.count(), active).size()),
              scene.layout.block_count());
  }
}

TEST(RaySetTest, FromOutsideEveryFaceCentreInViewHasARay) {
  const math::Index3 samples{33, 25, 17};
  const view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 3);
  const std::int64_t faces = 2 * (3 * 2 + 4 * 2 + 4 * 3);
  EXPECT_GE(rays.count(), faces + 1024 * 9 / 10);
  std::set<std::vector<double>> centers;
  for (std::int64_t number = 0; number < faces; ++number) {
    const std::optional<Ray> ray = rays.RayOf(number);
    ASSERT_TRUE(ray.has_value());
    const math::Vec3d center = ray->origin + ray->direction;
    centers.insert(
        {std::round(center.x * 1e6), std::round(center.y * 1e6), std::round(center.z * 1e6)});
    EXPECT_TRUE(std::abs(center.x) < 1e-9 || std::abs(center.x - 32) < 1e-9 ||
                std::abs(center.y) < 1e-9 || std::abs(center.y - 24) < 1e-9 ||
                std::abs(center.z) < 1e-9 || std::abs(center.z - 16) < 1e-9);
  }
  EXPECT_EQ(static_cast<std::int64_t>(centers.size()), faces);
}

TEST(RaySetTest, TheNumberOfRandomRaysFollowsTheViewport) {
  const math::Index3 samples{9, 9, 9};
  const view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  const std::int64_t faces = 6;
  const auto image_rays = [&](view::Viewport viewport) {
    const Scene scene = MakeScene(camera, samples, {8, 8, 8}, viewport);
    return RaySet(scene.view, scene.layout, 1).count() - faces;
  };
  EXPECT_EQ(image_rays({1024, 1024}), 128 * 128);
  EXPECT_EQ(image_rays({1920, 1080}), 240 * 135);
  EXPECT_EQ(image_rays({16384, 16384}), 256 * 256);
  EXPECT_EQ(image_rays({16, 16}), 32 * 32);
  EXPECT_GT(image_rays({1, 16384}), 1000);
  EXPECT_LE(image_rays({16384, 16}), 70000);
}

TEST(RaySetTest, AViewThatMissesTheVolumeHitsNothing) {
  const math::Index3 samples{33, 25, 17};
  view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  camera.target = camera.eye + (camera.eye - camera.target);
  for (const view::Projection projection :
       {view::Projection::kPerspective, view::Projection::kOrthographic}) {
    camera.projection = projection;
    const Scene scene = MakeScene(camera, samples, {8, 8, 8});
    const RaySet rays(scene.view, scene.layout, 3);
    EXPECT_THAT(rays.Cast(0, rays.count(), RandomBlocks(scene.layout, 1, 1)), IsEmpty());
  }
}

TEST(RaySetTest, TheHitsDoNotDependOnTheNumberOfAgents) {
  const math::Index3 samples{65, 49, 57};
  view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  view::Azimuth(0.6, &camera);
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 99);
  const BlockSet active = RandomBlocks(scene.layout, 0.2, 4);
  const std::vector<BlockId> all = rays.Cast(0, rays.count(), active);
  ASSERT_GT(all.size(), 20U);
  EXPECT_TRUE(std::is_sorted(all.begin(), all.end()));
  for (const int agents : {1, 2, 3, 7, 64}) {
    std::vector<BlockId> hits;
    for (int agent = 0; agent < agents; ++agent) {
      const RayShare share = ShareOfRays(rays.count(), agent, agents);
      hits = UnionOfHits(hits, rays.Cast(share.begin, share.end, active));
    }
    EXPECT_EQ(hits, all) << agents << " agents";
  }
  EXPECT_NE(RaySet(scene.view, scene.layout, 100).RayOf(rays.count() - 1)->direction,
            rays.RayOf(rays.count() - 1)->direction)
      << "the seed must matter";
}

TEST(ShareOfRaysTest, SharesFollowOneAnotherAndAreEven) {
  for (const std::int64_t count : {0, 1, 5, 1000, 65537}) {
    for (const int agents : {1, 2, 3, 16, 1001}) {
      std::int64_t next = 0;
      for (int agent = 0; agent < agents; ++agent) {
        const RayShare share = ShareOfRays(count, agent, agents);
        ASSERT_EQ(share.begin, next);
        ASSERT_GE(share.end - share.begin, count / agents);
        ASSERT_LE(share.end - share.begin, count / agents + 1);
        next = share.end;
      }
      ASSERT_EQ(next, count);
    }
  }
}

TEST(UnionOfHitsTest, IsASetUnion) {
  const std::vector<BlockId> a{1, 4, 9};
  const std::vector<BlockId> b{2, 4};
  EXPECT_THAT(UnionOfHits(a, b), ElementsAre(1, 2, 4, 9));
  EXPECT_EQ(UnionOfHits(a, b), UnionOfHits(b, a));
  EXPECT_EQ(UnionOfHits(a, a), a);
  EXPECT_EQ(UnionOfHits(a, {}), a);
  EXPECT_EQ(UnionOfHits({}, a), a);
}

TEST(OccludingBlocksTest, AreTheHitsAndTheirActiveNeighbours) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                BlockLayout::Make({50, 34, 26}, {8, 8, 8}));
  const BlockSet active = RandomBlocks(layout, 0.4, 17);
  std::vector<BlockId> hits;
  for (std::int64_t id = 0; id < layout.block_count(); id += 11) {
    if (active.Contains(static_cast<BlockId>(id))) {
      hits.push_back(static_cast<BlockId>(id));
    }
  }
  ASSERT_FALSE(hits.empty());
  BlockSet expected(layout.block_count());
  for (std::int64_t id = 0; id < layout.block_count(); ++id) {
    const auto block = static_cast<BlockId>(id);
    const bool touches = std::any_of(hits.begin(), hits.end(), [&](BlockId hit) {
      const math::Index3 d = layout.IndexOf(hit) - layout.IndexOf(block);
      return std::abs(d.x) <= 1 && std::abs(d.y) <= 1 && std::abs(d.z) <= 1;
    });
    if (touches && active.Contains(block)) {
      expected.Insert(block);
    }
  }
  EXPECT_EQ(OccludingBlocks(hits, layout, active), expected);
}

}  // namespace
}  // namespace isoscope::visibility
