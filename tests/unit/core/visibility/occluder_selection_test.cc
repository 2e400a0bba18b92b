// Rays are compared with a reference that computes them one at a time (Reference):
//
// - each ray stops at the first active block, which ExpectFirstBlocks finds by testing all blocks;
// - rays and hits are equal bit for bit, for any vectors, shares and runs of rays;
// - regions, small viewports, flat volumes, views that miss the volume;
// - a tree of active blocks, whose empty cubes are crossed at once: equal hits, wherever rays go;
// - the occluding blocks: the hits and their active neighbours.

#include "core/visibility/occluder_selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/highway.h"
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

// The blocks that rays [begin, end) hit, ascending: by the walk from block to block, and by the one
// that crosses empty cubes, which must find the same.
std::vector<BlockId> HitsOf(const RaySet& rays, std::int64_t begin, std::int64_t end,
                            const BlockLayout& layout, const BlockSet& active) {
  BlockSet hits(layout.block_count());
  rays.Cast(begin, end, active, &hits);
  const volume::BlockTree tree(layout.block_dims(), active);
  std::vector<std::uint64_t> marks(tree.words().size());
  rays.Cast(begin, end, tree, absl::MakeSpan(marks));
  EXPECT_EQ(tree.IdsOf(marks), hits.Ids()) << "rays " << begin << " to " << end;
  return hits.Ids();
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

// Tests every block: the ray must stop at the first active one, up to rounding on edges that it
// touches but does not cross. Returns the number of rays that hit something.
int ExpectFirstBlocks(const Scene& scene, const RaySet& rays, const BlockSet& active,
                      std::int64_t stride) {
  constexpr double kEdge = 1e-7;  // cells
  int hit_count = 0;
  for (std::int64_t number = 0; number < rays.count(); number += stride) {
    const std::vector<BlockId> hits = HitsOf(rays, number, number + 1, scene.layout, active);
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

// Pixel coordinates, in the whole viewport, of a point on a ray.
std::pair<double, double> PixelOf(const view::View& view, const Ray& ray) {
  const math::Vec3d p = ray.origin + ray.direction;
  const math::Vec4d clip = view.clip_from_index() * math::Vec4d{p.x, p.y, p.z, 1};
  return {view.viewport().width_px * (clip.x / clip.w + 1) / 2,
          view.viewport().height_px * (1 - clip.y / clip.w) / 2};
}

TEST(RaySetTest, RaysOfARegionMeetItAndFillIt) {
  const math::Index3 samples{41, 30, 35};
  for (const view::Projection projection :
       {view::Projection::kPerspective, view::Projection::kOrthographic}) {
    view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
    camera.projection = projection;
    Scene scene = MakeScene(camera, samples, {4, 4, 4}, {400, 300});
    const view::Region region{120, 90, 130, 80};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        scene.view, view::View::Make(camera, {400, 300}, scene.view.geometry(), region));
    const RaySet rays(scene.view, scene.layout, 5);
    std::set<std::pair<int, int>> cells;  // of a quarter of the region's sides
    std::int64_t ray_count = 0;
    for (std::int64_t i = 0; i < rays.count(); ++i) {
      const std::optional<Ray> ray = rays.RayOf(i);
      if (!ray.has_value()) {
        continue;
      }
      ++ray_count;
      const auto [x, y] = PixelOf(scene.view, *ray);
      ASSERT_GT(x, region.x - 1);
      ASSERT_LT(x, region.x + region.width_px + 1);
      ASSERT_GT(y, region.y - 1);
      ASSERT_LT(y, region.y + region.height_px + 1);
      cells.emplace(static_cast<int>((x - region.x) * 4 / region.width_px),
                    static_cast<int>((y - region.y) * 4 / region.height_px));
    }
    EXPECT_GE(cells.size(), 16U);
    EXPECT_GT(ray_count, 900);
  }
}

TEST(RaySetTest, ASinglePixelCastsFewRandomRays) {
  const math::Index3 samples{41, 30, 35};
  Scene scene =
      MakeScene(view::MakeDefaultCamera(BoundsOf(samples)), samples, {4, 4, 4}, {400, 300});
  const std::int64_t whole_count = RaySet(scene.view, scene.layout, 5).count();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      scene.view, view::View::Make(scene.view.camera(), {400, 300}, scene.view.geometry(),
                                   view::Region{200, 150, 1, 1}));
  EXPECT_LT(RaySet(scene.view, scene.layout, 5).count(), whole_count - 1000);
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
    EXPECT_EQ(static_cast<std::int64_t>(HitsOf(rays, 0, rays.count(), scene.layout, active).size()),
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
    EXPECT_THAT(HitsOf(rays, 0, rays.count(), scene.layout, RandomBlocks(scene.layout, 1, 1)),
                IsEmpty());
  }
}

TEST(RaySetTest, TheHitsDoNotDependOnTheNumberOfAgents) {
  const math::Index3 samples{65, 49, 57};
  view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  view::Azimuth(0.6, &camera);
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 99);
  const BlockSet active = RandomBlocks(scene.layout, 0.2, 4);
  const std::vector<BlockId> all = HitsOf(rays, 0, rays.count(), scene.layout, active);
  ASSERT_GT(all.size(), 20U);
  EXPECT_TRUE(std::is_sorted(all.begin(), all.end()));
  for (const int agents : {1, 2, 3, 7, 64}) {
    BlockSet hits(scene.layout.block_count());
    for (int agent = 0; agent < agents; ++agent) {
      const RayShare share = ShareOfRays(rays.count(), agent, agents);
      hits.InsertAll(HitsOf(rays, share.begin, share.end, scene.layout, active));
    }
    EXPECT_EQ(hits.Ids(), all) << agents << " agents";
  }
  EXPECT_NE(RaySet(scene.view, scene.layout, 100).RayOf(rays.count() - 1)->direction,
            rays.RayOf(rays.count() - 1)->direction)
      << "the seed must matter";
}

// Rays and walks by definition, one at a time: the vector code must give the same bits.
class Reference {
 public:
  Reference(const Scene& scene, std::uint64_t seed, std::int64_t grid_columns,
            std::int64_t grid_rows)
      : view_(scene.view),
        layout_(scene.layout),
        dims_(scene.layout.block_dims()),
        seed_(seed),
        columns_(grid_columns),
        rows_(grid_rows) {
    const view::Camera& camera = view_.camera();
    const double half_height =
        is_perspective() ? std::tan(camera.fov_y_radians / 2) : camera.view_height / 2;
    const math::Mat4d& m = view_.index_from_world();
    const double width = view_.viewport().width_px;
    const double height = view_.viewport().height_px;
    eye_ = math::TransformPoint(m, camera.eye);
    forward_ = math::TransformVector(m, view_.forward());
    half_right_ = math::TransformVector(m, view_.right() * (half_height * width / height));
    half_up_ = math::TransformVector(m, view_.up() * half_height);
  }

  [[nodiscard]] std::int64_t face_ray_count() const {
    return 2 * (dims_.x * dims_.y + dims_.x * dims_.z + dims_.y * dims_.z);
  }

  [[nodiscard]] std::optional<Ray> RayOf(std::int64_t number) const {
    return number < face_ray_count() ? FaceRay(number) : ImageRay(number - face_ray_count());
  }

  [[nodiscard]] std::optional<BlockId> FirstActiveBlock(const Ray& ray,
                                                        const BlockSet& active) const {
    double t_enter = 0;
    double t_exit = kInfinity;
    int enter_axis = -1;
    for (int axis = 0; axis < 3; ++axis) {
      const auto size = static_cast<double>(layout_.sample_dims()[axis] - 1);
      if (ray.direction[axis] == 0) {
        if (!(ray.origin[axis] >= 0 && ray.origin[axis] <= size)) {
          return std::nullopt;
        }
        continue;
      }
      const double t_low = (0 - ray.origin[axis]) / ray.direction[axis];
      const double t_high = (size - ray.origin[axis]) / ray.direction[axis];
      if (std::min(t_low, t_high) > t_enter) {
        t_enter = std::min(t_low, t_high);
        enter_axis = axis;
      }
      t_exit = std::min(t_exit, std::max(t_low, t_high));
    }
    if (!(t_enter <= t_exit)) {
      return std::nullopt;
    }
    math::Index3 block;
    std::array<double, 3> t_next{kInfinity, kInfinity, kInfinity};
    for (int axis = 0; axis < 3; ++axis) {
      const double direction = ray.direction[axis];
      const auto block_size = static_cast<double>(layout_.block_cells()[axis]);
      const std::int64_t last = dims_[axis] - 1;
      const double position = ray.origin[axis] + direction * t_enter;
      block[axis] = axis == enter_axis
                        ? (direction > 0 ? 0 : last)
                        : static_cast<std::int64_t>(std::clamp(std::floor(position / block_size),
                                                               0.0, static_cast<double>(last)));
      if (direction != 0) {
        const std::int64_t boundary = direction > 0 ? block[axis] + 1 : block[axis];
        t_next[static_cast<std::size_t>(axis)] =
            (static_cast<double>(boundary) * block_size - ray.origin[axis]) / direction;
      }
    }
    while (true) {
      if (active.Contains(layout_.IdOf(block))) {
        return layout_.IdOf(block);
      }
      const int axis = t_next[0] <= t_next[1] ? (t_next[0] <= t_next[2] ? 0 : 2)
                                              : (t_next[1] <= t_next[2] ? 1 : 2);
      double& t = t_next[static_cast<std::size_t>(axis)];
      if (t > t_exit || ray.direction[axis] == 0) {
        return std::nullopt;
      }
      block[axis] += ray.direction[axis] > 0 ? 1 : -1;
      if (block[axis] < 0 || block[axis] >= dims_[axis]) {
        return std::nullopt;
      }
      t += static_cast<double>(layout_.block_cells()[axis]) / std::abs(ray.direction[axis]);
    }
  }

 private:
  [[nodiscard]] bool is_perspective() const {
    return view_.camera().projection == view::Projection::kPerspective;
  }

  [[nodiscard]] std::optional<Ray> FaceRay(std::int64_t number) const {
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      for (const bool is_upper : {false, true}) {
        if (number >= dims_[u] * dims_[v]) {
          number -= dims_[u] * dims_[v];
          continue;
        }
        math::Index3 block;
        block[axis] = is_upper ? dims_[axis] - 1 : 0;
        block[v] = number / dims_[u];
        block[u] = block[v] % 2 == 0 ? number % dims_[u] : dims_[u] - 1 - number % dims_[u];
        const math::IndexBox cells = layout_.CellsOf(layout_.IdOf(block));
        math::Vec3d center;
        center[u] = 0.5 * static_cast<double>(cells.begin[u] + cells.end[u]);
        center[v] = 0.5 * static_cast<double>(cells.begin[v] + cells.end[v]);
        center[axis] = static_cast<double>(is_upper ? cells.end[axis] : cells.begin[axis]);
        return RayThrough(center);
      }
    }
    return std::nullopt;
  }

  [[nodiscard]] std::optional<Ray> RayThrough(const math::Vec3d& center) const {
    const math::Vec4d clip = view_.clip_from_index() * math::Vec4d{center.x, center.y, center.z, 1};
    if (!(clip.w > 0) || std::abs(clip.x) > 1.02 * clip.w || std::abs(clip.y) > 1.02 * clip.w) {
      return std::nullopt;
    }
    if (is_perspective()) {
      return Ray{eye_, center - eye_};
    }
    const math::Vec3d offset =
        math::TransformPoint(view_.world_from_index(), center) - view_.camera().eye;
    const double distance = math::Dot(view_.forward(), offset);
    return Ray{center + forward_ * (view_.near_distance() - distance), forward_};
  }

  [[nodiscard]] Ray ImageRay(std::int64_t number) const {
    const std::int64_t row = number / columns_;
    const std::int64_t column = row % 2 == 0 ? number % columns_ : columns_ - 1 - number % columns_;
    const auto counter = static_cast<std::uint64_t>(number) * 2;
    const double x = (static_cast<double>(column) + base::RandomUnit(seed_, counter)) /
                     static_cast<double>(columns_);
    const double y = (static_cast<double>(row) + base::RandomUnit(seed_, counter + 1)) /
                     static_cast<double>(rows_);
    const math::Vec3d offset = half_right_ * (2 * x - 1) + half_up_ * (1 - 2 * y);
    if (is_perspective()) {
      return {eye_, forward_ + offset};
    }
    return {eye_ + offset + forward_ * view_.near_distance(), forward_};
  }

  const view::View& view_;
  const BlockLayout& layout_;
  const math::Index3 dims_;
  const std::uint64_t seed_;
  const std::int64_t columns_;
  const std::int64_t rows_;
  math::Vec3d eye_;
  math::Vec3d forward_;
  math::Vec3d half_right_;
  math::Vec3d half_up_;
};

// Every ray, and every block hit by every run of rays, against the reference; returns how many rays
// hit. `viewport` of the scene is 64 x 48: 1024 random rays on a grid of 37 x 28.
std::int64_t ExpectAsReference(const Scene& scene, const BlockSet& active) {
  constexpr std::uint64_t kSeed = 7;
  const RaySet rays(scene.view, scene.layout, kSeed);
  const Reference reference(scene, kSeed, 37, 28);
  EXPECT_EQ(rays.count(), reference.face_ray_count() + std::int64_t{37} * 28);
  std::vector<std::optional<BlockId>> first(static_cast<std::size_t>(rays.count()));
  std::int64_t hit_count = 0;
  for (std::int64_t number = 0; number < rays.count(); ++number) {
    const std::optional<Ray> ray = rays.RayOf(number);
    const std::optional<Ray> expected = reference.RayOf(number);
    EXPECT_EQ(ray.has_value(), expected.has_value()) << "ray " << number;
    if (ray.has_value() && expected.has_value()) {
      EXPECT_EQ(ray->origin, expected->origin) << "ray " << number;
      EXPECT_EQ(ray->direction, expected->direction) << "ray " << number;
      first[static_cast<std::size_t>(number)] = reference.FirstActiveBlock(*expected, active);
    }
    hit_count += first[static_cast<std::size_t>(number)].has_value() ? 1 : 0;
  }
  // Runs that begin and end anywhere in a row, or span several.
  for (const std::int64_t length : {std::int64_t{1}, std::int64_t{11}, rays.count()}) {
    for (std::int64_t begin = 0; begin < rays.count(); begin += length) {
      const std::int64_t end = std::min(begin + length, rays.count());
      std::set<BlockId> expected;
      for (std::int64_t number = begin; number < end; ++number) {
        const std::optional<BlockId>& block = first[static_cast<std::size_t>(number)];
        if (block.has_value()) {
          expected.insert(*block);
        }
      }
      EXPECT_THAT(HitsOf(rays, begin, end, scene.layout, active),
                  ::testing::ElementsAreArray(expected))
          << "rays " << begin << " to " << end;
    }
  }
  return hit_count;
}

TEST(RaySetTest, RaysAndHitsAreBitForBitThoseOfTheReferenceWhateverTheProcessorsVectors) {
  struct Case {
    math::Index3 samples;
    math::Index3 block_cells;
    double azimuth;
    double elevation;
    bool is_orthographic;
    bool is_inside;  // the eye
    double share;    // of blocks that are active
  };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    for (const Case& c : {
             Case{{41, 30, 35}, {8, 7, 9}, 0.4, 0.3, false, false, 0.2},
             Case{{41, 30, 35}, {8, 7, 9}, -2.1, 0.6, true, false, 0.2},
             Case{{65, 65, 65}, {8, 8, 8}, 0.0, 0.0, false, false, 0.03},  // rays meet edges
             Case{{65, 65, 65}, {8, 8, 8}, 0.0, 0.0, true, false, 0.03},
             Case{{65, 65, 65}, {4, 4, 4}, 1.0, -0.5, false, true, 0.01},
             Case{{70, 9, 66}, {1, 2, 3}, 2.5, -1.2, false, false, 0.001},
             Case{{3000, 3, 2}, {4, 1, 1}, 1.3, 0.1, false, false, 0.002},  // a long row of blocks
             Case{{40, 40, 2}, {8, 8, 8}, 0.5, 0.0, true, false, 0.5},
             Case{{41, 30, 35}, {8, 7, 9}, 0.4, 0.3, false, false, 0.0},
         }) {
      view::Camera camera = view::MakeDefaultCamera(BoundsOf(c.samples));
      view::Azimuth(c.azimuth, &camera);
      view::Elevation(c.elevation, &camera);
      view::OrthogonalizeUp(&camera);
      if (c.is_orthographic) {
        camera.projection = view::Projection::kOrthographic;
      }
      if (c.is_inside) {
        camera.eye = camera.target + (camera.eye - camera.target) * 0.05;
      }
      const Scene scene = MakeScene(camera, c.samples, c.block_cells);
      const std::int64_t hit_count =
          ExpectAsReference(scene, RandomBlocks(scene.layout, c.share, 11));
      EXPECT_EQ(hit_count > 0, c.share > 0) << c.samples.x << " " << c.azimuth;
      ASSERT_FALSE(HasFailure()) << hwy::TargetName(target) << ", " << c.samples.x << " x "
                                 << c.samples.y << " x " << c.samples.z << " samples, azimuth "
                                 << c.azimuth;
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

// A few clusters of active blocks in a mostly empty volume, so that cubes of all sizes occur.
BlockSet RandomClusters(const BlockLayout& layout, std::uint64_t seed) {
  BlockSet active(layout.block_count());
  std::uint64_t counter = 0;
  const auto random = [&](double end) { return base::RandomUnit(seed, counter++) * end; };
  const math::Index3& dims = layout.block_dims();
  const auto cluster_count = static_cast<int>(random(6));
  for (int cluster = 0; cluster < cluster_count; ++cluster) {
    math::Vec3d center;
    for (int axis = 0; axis < 3; ++axis) {
      center[axis] = random(static_cast<double>(dims[axis]));
    }
    const double radius = random(8);
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      const math::Index3 index = layout.IndexOf(static_cast<BlockId>(id));
      const math::Vec3d offset =
          math::Vec3d{static_cast<double>(index.x), static_cast<double>(index.y),
                      static_cast<double>(index.z)} -
          center;
      if (math::Length(offset) < radius && random(1) < 0.5) {
        active.Insert(static_cast<BlockId>(id));
      }
    }
  }
  return active;
}

TEST(RaySetTest, EmptyCubesAreCrossedAsIfBlockByBlock) {
  std::int64_t hit_count = 0;
  for (std::uint64_t seed = 0; seed < 150; ++seed) {
    std::uint64_t counter = 0;
    const auto random = [&](double begin, double end) {
      return begin + base::RandomUnit(1000 + seed, counter++) * (end - begin);
    };
    math::Index3 samples;
    math::Index3 cells;
    for (int axis = 0; axis < 3; ++axis) {
      cells[axis] = static_cast<std::int64_t>(random(1, 4));
      const double most = random(0, 1) < 0.2 ? 4 : 120;
      samples[axis] = static_cast<std::int64_t>(random(2, most));
    }
    view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
    if (seed % 4 != 0) {  // else along an axis, where many boundaries are met at once
      view::Azimuth(random(-4, 4), &camera);
      view::Elevation(random(-1.4, 1.4), &camera);
      view::OrthogonalizeUp(&camera);
    }
    if (random(0, 1) < 0.4) {
      camera.projection = view::Projection::kOrthographic;
    } else if (random(0, 1) < 0.5) {  // in the volume: t begins at 0
      camera.eye = camera.target + (camera.eye - camera.target) * random(0, 0.3);
    }
    const Scene scene = MakeScene(camera, samples, cells);
    const RaySet rays(scene.view, scene.layout, seed);
    const BlockSet active = RandomClusters(scene.layout, seed);
    hit_count +=
        static_cast<std::int64_t>(HitsOf(rays, 0, rays.count(), scene.layout, active).size());
    // Few rays at a time: else hits of others hide that one went astray.
    for (std::int64_t begin = 0; begin < rays.count(); begin += 37) {
      HitsOf(rays, begin, std::min(begin + 3, rays.count()), scene.layout, active);
    }
    ASSERT_FALSE(HasFailure()) << "seed " << seed;
  }
  EXPECT_GT(hit_count, 1000);
}

TEST(RaySetTest, AVolumeWithManyFacesHasRaysThroughEveryFewOfThem) {
  const auto count_of = [](const math::Index3& samples) {
    const Scene scene = MakeScene(view::MakeDefaultCamera(BoundsOf(samples)), samples, {1, 1, 1});
    const RaySet rays(scene.view, scene.layout, 1);
    EXPECT_TRUE(rays.RayOf(0).has_value());
    for (std::int64_t i = 0; i < rays.count(); i += 997) {
      const std::optional<Ray> ray = rays.RayOf(i);
      EXPECT_TRUE(!ray.has_value() || math::IsFinite(ray->direction));
    }
    return rays.count() - std::int64_t{37} * 28;
  };
  EXPECT_EQ(count_of({201, 201, 201}), 6 * 200 * 200);
  EXPECT_EQ(count_of({301, 301, 301}), 6 * 150 * 150);
  EXPECT_EQ(count_of({702, 601, 501}), 2 * (234 * 200 + 200 * 167 + 167 * 234));
}

TEST(RaySetTest, AnEdgeBetweenBlocksIsCrossedAlongTheLowerAxisFirst) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {33, 33, 33};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                BlockLayout::Make(geometry.sample_dims, {8, 8, 8}));
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    for (const auto& [low, high] : {std::pair{0, 1}, std::pair{0, 2}, std::pair{1, 2}}) {
      // Through the centre of the first face normal to `low`, then through the edge at 8, 8.
      view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
      camera.eye = {4, 4, 4};
      camera.eye[low] = -16;
      camera.eye[high] = -4;
      camera.target = {4, 4, 4};
      camera.target[low] = 0;
      camera.up = {0, 0, 0};
      camera.up[3 - low - high] = 1;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                    view::View::Make(camera, {64, 48}, geometry));
      const RaySet rays(view, layout, 1);
      const std::int64_t number = std::int64_t{low} * 2 * 16;
      math::Vec3d direction;
      direction[low] = 16;
      direction[high] = 8;
      ASSERT_TRUE(rays.RayOf(number).has_value());
      ASSERT_EQ(rays.RayOf(number)->direction, direction);
      math::Index3 along_low;
      along_low[low] = 1;
      math::Index3 along_high;
      along_high[high] = 1;
      BlockSet active(layout.block_count());
      active.Insert(layout.IdOf(along_low));
      active.Insert(layout.IdOf(along_high));
      EXPECT_THAT(HitsOf(rays, number, number + 1, layout, active),
                  ElementsAre(layout.IdOf(along_low)))
          << hwy::TargetName(target) << ", axes " << low << " and " << high;
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(RaySetTest, HitsAreAddedToThoseOfEarlierCalls) {
  const math::Index3 samples{33, 33, 33};
  const view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 1);
  const BlockSet active = RandomBlocks(scene.layout, 0.3, 5);
  BlockSet hits(scene.layout.block_count());
  rays.Cast(0, 40, active, &hits);
  rays.Cast(100, rays.count(), active, &hits);
  rays.Cast(40, 100, active, &hits);
  rays.Cast(50, 50, active, &hits);
  EXPECT_EQ(hits.Ids(), HitsOf(rays, 0, rays.count(), scene.layout, active));
}

TEST(RaySetDeathTest, SetsOfAnotherVolumeAreRefused) {
  const math::Index3 samples{65, 65, 65};
  const view::Camera camera = view::MakeDefaultCamera(BoundsOf(samples));
  const Scene scene = MakeScene(camera, samples, {8, 8, 8});
  const RaySet rays(scene.view, scene.layout, 1);
  BlockSet right(scene.layout.block_count());
  BlockSet wrong(scene.layout.block_count() - 64);
  EXPECT_DEATH(rays.Cast(0, 1, wrong, &right), "active.words");
  EXPECT_DEATH(rays.Cast(0, 1, right, &wrong), "hits->words");
  EXPECT_DEATH(rays.Cast(0, rays.count() + 1, right, &right), "end <= count");
  const volume::BlockTree tree({8, 8, 7}, BlockSet(8 * 8 * 7));
  const volume::BlockTree empty(scene.layout.block_dims(), right);
  std::vector<std::uint64_t> marks(1);
  EXPECT_DEATH(rays.Cast(0, 1, tree, {}), "block_dims");
  EXPECT_DEATH(rays.Cast(0, 1, empty, absl::MakeSpan(marks)), "hits.size");
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
  EXPECT_EQ(OccludingBlocks(BlockSet(layout.block_count(), hits), layout, active), expected);
}

TEST(OccludingBlocksTest, NeighboursDoNotWrapAroundRowsOrSlabs) {
  for (const math::Index3& dims :
       {math::Index3{1, 1, 1}, math::Index3{64, 3, 3}, math::Index3{63, 2, 3},
        math::Index3{65, 4, 2}, math::Index3{130, 1, 5}, math::Index3{1, 70, 3},
        math::Index3{2, 1, 130}, math::Index3{7, 9, 11}, math::Index3{32, 32, 1}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                  BlockLayout::Make(dims + math::Index3{1, 1, 1}, {1, 1, 1}));
    for (const double share : {0.0, 0.02, 0.3}) {
      const BlockSet active = RandomBlocks(layout, 0.6, 3);
      // Hits that are not active stay as well.
      const std::vector<BlockId> hits = RandomBlocks(layout, share, 8).Ids();
      BlockSet expected(layout.block_count());
      for (const BlockId hit : hits) {
        expected.Insert(hit);
        const math::Index3 center = layout.IndexOf(hit);
        for (std::int64_t n = 0; n < 27; ++n) {
          const math::Index3 block = center + math::Index3{n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
          bool is_in_volume = true;
          for (int axis = 0; axis < 3; ++axis) {
            is_in_volume = is_in_volume && block[axis] >= 0 && block[axis] < dims[axis];
          }
          if (is_in_volume && active.Contains(layout.IdOf(block))) {
            expected.Insert(layout.IdOf(block));
          }
        }
      }
      EXPECT_EQ(OccludingBlocks(BlockSet(layout.block_count(), hits), layout, active), expected)
          << dims.x << " x " << dims.y << " x " << dims.z << ", share " << share;
    }
  }
}

}  // namespace
}  // namespace isoscope::visibility
