// Matrices are compared with VTK's numbers, and footprints with float32 renderers:
//
// - projection, clip planes, and cameras inside, outside and behind the volume;
// - footprints: no point of a block is drawn outside its rectangle or nearer than its depth;
// - the same bits for one box and many, on every instruction set;
// - limits of float32; regions.

#include "core/view/view.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/view/footprint_kernel.h"
#include "hwy/highway.h"
#include "hwy/targets.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;

constexpr double kDegree = std::numbers::pi / 180;

class Random {
 public:
  explicit Random(std::uint64_t seed) : seed_(seed) {}
  double Uniform(double low, double high) {
    return low + (high - low) * base::RandomUnit(seed_, counter_++);
  }
  int Index(int count) { return static_cast<int>(Uniform(0, count)); }
  math::Vec3d Point(const math::Vec3d& low, const math::Vec3d& high) {
    const double x = Uniform(low.x, high.x);
    const double y = Uniform(low.y, high.y);
    return {x, y, Uniform(low.z, high.z)};
  }

 private:
  std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

volume::GridGeometry MakeGeometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {65, 33, 49};
  geometry.spacing = {0.5, 1, 0.75};
  geometry.origin = {-3, 10, 100};
  return geometry;
}

math::Vec3d MaxIndex(const volume::GridGeometry& geometry) {
  return {static_cast<double>(geometry.sample_dims.x - 1),
          static_cast<double>(geometry.sample_dims.y - 1),
          static_cast<double>(geometry.sample_dims.z - 1)};
}

math::Vec3d Ndc(const math::Mat4d& matrix, const math::Vec3d& p) {
  const math::Vec4d clip = matrix * math::Vec4d{p.x, p.y, p.z, 1};
  return {clip.x / clip.w, clip.y / clip.w, clip.z / clip.w};
}

// Numbers of VTK 9.1's composite projection matrix for x, y (they do not depend on the planes).
TEST(ViewTest, ProjectsAsVtkDoes) {
  Camera camera;
  camera.eye = {2.8525836845494386, 3.1821478391883056, 13.778240124345146};
  camera.target = {1, 2, 3};
  camera.up = {0.80289962111574342, 0.56170077906599736, -0.19961070414395918};
  camera.fov_y_radians = 40 * kDegree;
  const math::Vec3d point{0.5, 2.5, 3.25};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {640, 480}, MakeGeometry()));
  math::Vec3d ndc = Ndc(view.clip_from_world(), point);
  EXPECT_NEAR(ndc.x, -0.13338543473613146, 1e-12);
  EXPECT_NEAR(ndc.y, -0.04343331678754364, 1e-12);

  camera.projection = Projection::kOrthographic;
  camera.view_height = 14;  // twice vtkCamera's parallel scale
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View parallel,
                                View::Make(camera, {640, 480}, MakeGeometry()));
  ndc = Ndc(parallel.clip_from_world(), point);
  EXPECT_NEAR(ndc.x, -0.074802669675156266, 1e-12);
  EXPECT_NEAR(ndc.y, -0.024357442437266175, 1e-12);
}

TEST(ViewTest, PlanesEncloseTheVolumeAndDepthIsZeroNearOneFar) {
  const volume::GridGeometry geometry = MakeGeometry();
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    Camera camera = MakeDefaultCamera(geometry.Bounds());
    camera.projection = projection;
    Azimuth(0.7, &camera);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {300, 200}, geometry));
    double nearest = std::numeric_limits<double>::infinity();
    double farthest = 0;
    for (const math::Vec3d& corner : math::Box3d{{0, 0, 0}, MaxIndex(geometry)}.Corners()) {
      const math::Vec3d ndc = Ndc(view.clip_from_index(), corner);
      EXPECT_GT(ndc.z, -1);
      EXPECT_LT(ndc.z, 1);
      const math::Vec3d world = math::TransformPoint(view.world_from_index(), corner);
      const double distance = math::Dot(view.forward(), world - camera.eye);
      nearest = std::min(nearest, distance);
      farthest = std::max(farthest, distance);
      const math::Vec3d from_world = Ndc(view.clip_from_world(), world);
      EXPECT_NEAR(from_world.x, ndc.x, 1e-12);
      EXPECT_NEAR(from_world.z, ndc.z, 1e-11);
    }
    EXPECT_NEAR(view.near_distance(), nearest, 0.01 * (farthest - nearest));
    EXPECT_NEAR(view.far_distance(), farthest, 0.01 * (farthest - nearest));
    const math::Vec3d near_point = camera.eye + view.forward() * view.near_distance();
    EXPECT_NEAR(Ndc(view.clip_from_world(), near_point).z, -1, 1e-9);
    const math::Vec3d far_point = camera.eye + view.forward() * view.far_distance();
    EXPECT_NEAR(Ndc(view.clip_from_world(), far_point).z, 1, 1e-9);
  }
}

TEST(ViewTest, AnEyeInsideKeepsThePlanesInFrontOfIt) {
  const volume::GridGeometry geometry = MakeGeometry();
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  camera.eye = geometry.Bounds().Center();
  camera.target = camera.eye + math::Vec3d{1, 0.5, 0.25};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View inside, View::Make(camera, {64, 64}, geometry));
  EXPECT_DOUBLE_EQ(inside.near_distance(), 1e-3 * inside.far_distance());
  camera.projection = Projection::kOrthographic;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View parallel, View::Make(camera, {64, 64}, geometry));
  EXPECT_EQ(parallel.near_distance(), 0);
  EXPECT_GT(parallel.far_distance(), 0);
}

TEST(ViewTest, AVolumeBehindTheEyeIsAnEmptyPicture) {
  const volume::GridGeometry geometry = MakeGeometry();
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    Camera camera = MakeDefaultCamera(geometry.Bounds());
    camera.projection = projection;
    camera.target = camera.eye + (camera.eye - camera.target);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {64, 64}, geometry));
    EXPECT_LT(view.near_distance(), view.far_distance());
    EXPECT_TRUE(view.FootprintOf({0, 0, 0}, MaxIndex(geometry)).rect.empty());
  }
}

TEST(ViewTest, WhatDoesNotValidateIsRefused) {
  const volume::GridGeometry geometry = MakeGeometry();
  const Camera camera = MakeDefaultCamera(geometry.Bounds());
  Camera bad_camera = camera;
  bad_camera.fov_y_radians = 4;
  EXPECT_THAT(View::Make(bad_camera, {64, 64}, geometry),
              StatusIs(absl::StatusCode::kInvalidArgument, _));
  EXPECT_THAT(View::Make(camera, {64, 0}, geometry),
              StatusIs(absl::StatusCode::kInvalidArgument, _));
  volume::GridGeometry bad_geometry = geometry;
  bad_geometry.spacing.x = 0;
  EXPECT_THAT(View::Make(camera, {64, 64}, bad_geometry),
              StatusIs(absl::StatusCode::kInvalidArgument, _));
  bad_geometry = geometry;
  bad_geometry.origin.x = 1e308;
  bad_geometry.spacing.x = 1e308;
  EXPECT_THAT(View::Make(camera, {64, 64}, bad_geometry),
              StatusIs(absl::StatusCode::kInvalidArgument, _));
}

TEST(FootprintTest, AFaceOnBoxHasTheExpectedPixels) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {101, 101, 101};
  Camera camera;
  camera.projection = Projection::kOrthographic;
  camera.view_height = 100;
  camera.target = {50, 50, 0};
  camera.eye = {50, 50, 200};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {100, 100}, geometry));
  // One cell is one pixel; centres at + 0.5 leave room for the margin.
  const Footprint footprint = view.FootprintOf({10, 20, 30}, {15, 28, 33});
  EXPECT_EQ(footprint.rect, (PixelRect{10, 72, 15, 80}));
  const double depth =
      (200 - 33 - view.near_distance()) / (view.far_distance() - view.near_distance());
  EXPECT_LE(footprint.nearest_depth, depth);
  EXPECT_NEAR(footprint.nearest_depth, depth, 1e-7);
  // A corner on a pixel centre counts.
  EXPECT_EQ(view.FootprintOf({10.5, 20.5, 30}, {14.5, 27.5, 33}).rect, (PixelRect{10, 72, 15, 80}));
  // Cut at the border, and outside of it.
  EXPECT_EQ(view.FootprintOf({-10, -10, 0}, {5, 5, 1}).rect, (PixelRect{0, 95, 5, 100}));
  EXPECT_TRUE(view.FootprintOf({-10, 0, 0}, {-5, 5, 1}).rect.empty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout,
                                volume::BlockLayout::Make(geometry.sample_dims, {8, 8, 8}));
  EXPECT_EQ(view.FootprintOf(layout, layout.IdOf({1, 2, 12})).rect, (PixelRect{8, 76, 16, 84}));
  EXPECT_EQ(view.FootprintOf(layout, layout.IdOf({12, 12, 12})).rect, (PixelRect{96, 0, 100, 4}));
}

TEST(FootprintTest, ABoxAcrossTheNearPlaneHasTheWholeViewport) {
  const volume::GridGeometry geometry = MakeGeometry();
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  camera.eye = geometry.Bounds().Center();
  camera.target = camera.eye + math::Vec3d{0, 0, 1};
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    camera.projection = projection;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {40, 30}, geometry));
    const math::Vec3d eye = math::TransformPoint(view.index_from_world(), camera.eye);
    const Footprint around =
        view.FootprintOf(eye - math::Vec3d{1, 1, 1}, eye + math::Vec3d{1, 1, 1});
    EXPECT_EQ(around.rect, (PixelRect{0, 0, 40, 30}));
    EXPECT_EQ(around.nearest_depth, 0);
    EXPECT_TRUE(
        view.FootprintOf(eye + math::Vec3d{-1, -1, -9}, eye + math::Vec3d{1, 1, -7}).rect.empty());
    // Beside the frustum although it crosses the plane of the eye.
    if (projection == Projection::kOrthographic) {
      EXPECT_TRUE(view.FootprintOf(eye + math::Vec3d{900, -1, -1}, eye + math::Vec3d{950, 1, 1})
                      .rect.empty());
    }
  }
}

TEST(FootprintTest, ABoxBeyondFloatPrecisionHasTheWholeViewport) {
  volume::GridGeometry geometry = MakeGeometry();
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  // A view of a millionth of a cell: float32 can't place its vertices.
  camera.projection = Projection::kOrthographic;
  camera.view_height = 1e-6;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {64, 64}, geometry));
  const Footprint footprint = view.FootprintOf({31, 15, 20}, {33, 17, 22});
  EXPECT_EQ(footprint.rect, (PixelRect{0, 0, 64, 64}));
  EXPECT_EQ(footprint.nearest_depth, 0);
}

// A vertex as a renderer in float32 computes it, with the sums in the given order.
struct FloatVertex {
  float x;
  float y;
  float z;
  float w;
};
FloatVertex TransformInFloat(const View& view, const math::Vec3f& p, bool reversed) {
  float out[4];
  for (std::size_t row = 0; row < 4; ++row) {
    const auto m = [&](std::size_t column) {
      return static_cast<float>(view.clip_from_index().At(row, column));
    };
    const float x = m(0) * p.x;
    const float y = m(1) * p.y;
    const float z = m(2) * p.z;
    if (reversed) {
      const float from_z = m(3) + z;
      out[row] = (from_z + y) + x;
    } else {
      out[row] = ((x + y) + z) + m(3);
    }
  }
  return {out[0], out[1], out[2], out[3]};
}

// Some volume of at most `max_samples` a side, seen from outside to well inside of it, and zoomed
// in.
absl::StatusOr<View> RandomView(int max_samples, Random* random) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {2 + random->Index(max_samples - 2), 2 + random->Index(max_samples - 2),
                          2 + random->Index(max_samples - 2)};
  geometry.spacing = random->Point({0.1, 0.1, 0.1}, {3, 3, 3});
  geometry.origin = random->Point({-500, -500, -500}, {500, 500, 500});
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  Azimuth(random->Uniform(-3, 3), &camera);
  Elevation(random->Uniform(-1.4, 1.4), &camera);
  OrthogonalizeUp(&camera);
  camera.eye = camera.target + (camera.eye - camera.target) * random->Uniform(0.02, 1.5);
  Zoom(random->Uniform(0.5, 6), &camera);
  if (random->Index(2) == 0) {
    camera.projection = Projection::kOrthographic;
  }
  const Viewport viewport{1 + random->Index(2000), 1 + random->Index(2000)};
  return View::Make(camera, viewport, geometry);
}

std::vector<volume::BlockId> SomeBlocks(const volume::BlockLayout& layout, Random* random) {
  std::vector<volume::BlockId> ids;
  for (std::int64_t id = 0; id < layout.block_count(); id += 1 + random->Index(4)) {
    ids.push_back(static_cast<volume::BlockId>(id));
  }
  return ids;
}

// Culling relies on this. A triangle of the block covers only pixels whose centre is in the hull of
// its vertices, as placed by float32 and sub-pixel snapping. These pixels must lie in the block's
// rectangle.
TEST(FootprintTest, NoPointOfABoxIsDrawnOutsideItsRectangle) {
  Random random(7);
  std::int64_t boxes_seen = 0;
  for (int round = 0; round < 400; ++round) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, RandomView(702, &random));
    const volume::GridGeometry& geometry = view.geometry();
    const Viewport& viewport = view.viewport();
    const auto width = static_cast<float>(viewport.width_px);
    const auto height = static_cast<float>(viewport.height_px);
    for (int b = 0; b < 25; ++b) {
      const math::Vec3d a = random.Point({0, 0, 0}, MaxIndex(geometry));
      const math::Vec3d low{std::floor(a.x), std::floor(a.y), std::floor(a.z)};
      const double size = 1 + random.Index(16);
      const math::Vec3d high = low + math::Vec3d{size, size, size};
      const Footprint footprint = view.FootprintOf(low, high);
      ASSERT_GE(footprint.nearest_depth, 0);
      ASSERT_LE(footprint.nearest_depth, 0x1.fffffep-1F);
      math::Box3d hull;
      for (int i = 0; i < 60; ++i) {
        math::Vec3d exact = random.Point(low, high);
        for (int axis = 0; axis < 3;
             ++axis) {  // most vertices that matter are on faces and corners
          const int side = random.Index(4);
          exact[axis] = side == 0 ? low[axis] : side == 1 ? high[axis] : exact[axis];
        }
        const math::Vec3f p{static_cast<float>(exact.x), static_cast<float>(exact.y),
                            static_cast<float>(exact.z)};
        const FloatVertex v = TransformInFloat(view, p, i % 2 == 0);
        if (!(v.z >= -v.w) || !(v.z <= v.w) || !(v.w > 0)) {
          continue;  // clipped
        }
        const float x = (v.x / v.w * 0.5F + 0.5F) * width;
        const float y = (0.5F - v.y / v.w * 0.5F) * height;
        // Snapped to a grid of 1/16 pixel, down or up.
        const double snapped_x = std::floor(static_cast<double>(x) * 16 + random.Index(2)) / 16;
        const double snapped_y = std::floor(static_cast<double>(y) * 16 + random.Index(2)) / 16;
        hull.Add({snapped_x, snapped_y, 0});
        if (footprint.rect.empty()) {
          continue;
        }
        const double depth = static_cast<double>(v.z) / static_cast<double>(v.w) * 0.5 + 0.5;
        // Renderers clamp, so this is not needed for exactness; it shows that the clamp is a matter
        // of rounding: 16 u of the sizes in the sum.
        ASSERT_GT(depth, static_cast<double>(footprint.nearest_depth) - 2e-3) << "round " << round;
      }
      // The pixels of the viewport whose centres are in the hull.
      const int begin_x = static_cast<int>(std::max(0.0, std::ceil(hull.min.x - 0.5)));
      const int begin_y = static_cast<int>(std::max(0.0, std::ceil(hull.min.y - 0.5)));
      const int end_x = static_cast<int>(std::min<double>(width, std::floor(hull.max.x - 0.5) + 1));
      const int end_y =
          static_cast<int>(std::min<double>(height, std::floor(hull.max.y - 0.5) + 1));
      if (hull.min.x > hull.max.x || begin_x >= end_x || begin_y >= end_y) {
        continue;
      }
      ++boxes_seen;
      ASSERT_LE(footprint.rect.begin_x, begin_x) << "round " << round;
      ASSERT_LE(footprint.rect.begin_y, begin_y) << "round " << round;
      ASSERT_GE(footprint.rect.end_x, end_x) << "round " << round;
      ASSERT_GE(footprint.rect.end_y, end_y) << "round " << round;
    }
  }
  EXPECT_GT(boxes_seen, 2000);
}

// Where a pixel is a small part of a cell, the error of float32's clip coordinates is more than all
// other bounds together.
TEST(FootprintTest, AVertexZoomedInUntilFloatMovesItIsInsideItsRectangle) {
  Random random(11);
  int moved_count = 0;
  constexpr int kSide = 1000;
  for (int round = 0; round < 3000; ++round) {
    volume::GridGeometry geometry;
    geometry.sample_dims = {700, 700, 700};
    Camera camera = MakeDefaultCamera(geometry.Bounds());
    camera.projection = Projection::kOrthographic;
    camera.view_height = random.Uniform(0.6, 1.2);
    // The corner lies as far left of a pixel's centre as the other bounds reach, and a bit.
    const int column = 300 + random.Index(400);
    const double corner_px = column + 0.5 - kSnapErrorPx - 0.002;
    const math::Vec3d corner{500.0 + random.Index(190), 500.0 + random.Index(190),
                             500.0 + random.Index(190)};
    const math::Vec3d target =
        corner - math::Vec3d{(corner_px - kSide / 2) * camera.view_height / kSide, 0, 0};
    camera.eye = camera.eye + (target - camera.target);
    camera.target = target;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {kSide, kSide}, geometry));
    const Footprint footprint = view.FootprintOf(corner - math::Vec3d{1, 1, 1}, corner);
    const math::Vec3f p{static_cast<float>(corner.x), static_cast<float>(corner.y),
                        static_cast<float>(corner.z)};
    const FloatVertex v = TransformInFloat(view, p, round % 2 == 0);
    const double vertex_px = (static_cast<double>(v.x) * 0.5 + 0.5) * kSide + kSnapErrorPx;
    const int end = static_cast<int>(std::floor(vertex_px - 0.5)) + 1;
    moved_count += end > column ? 1 : 0;
    ASSERT_GE(footprint.rect.end_x, end) << "round " << round;
  }
  EXPECT_GT(moved_count, 100) << "float32 must move vertices here";
}

// The occlusion test compares depths for equality: half a unit in the last place too far hides a
// block that shows.
TEST(FootprintTest, TheNearestDepthIsNeverBehindTheNearestCorner) {
  Random random(12);
  int rounded_count = 0;
  for (int round = 0; round < 300; ++round) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, RandomView(200, &random));
    for (int b = 0; b < 10; ++b) {
      const math::Vec3d low = random.Point({0, 0, 0}, MaxIndex(view.geometry()));
      const math::Vec3d high = low + math::Vec3d{8, 8, 8};
      const Footprint footprint = view.FootprintOf(low, high);
      if (footprint.rect.empty() || footprint.nearest_depth == 0) {
        continue;
      }
      double nearest = 1;
      for (int i = 0; i < 8; ++i) {
        const math::Vec4d clip =
            view.clip_from_index() * math::Vec4d{(i & 1) != 0 ? high.x : low.x,
                                                 (i & 2) != 0 ? high.y : low.y,
                                                 (i & 4) != 0 ? high.z : low.z, 1};
        nearest = std::min(nearest, clip.z / clip.w * 0.5 + 0.5);
      }
      // Double's own rounding is 2^-50 or so, float's 2^-25.
      ASSERT_LE(footprint.nearest_depth, nearest + 1e-12);
      rounded_count += static_cast<double>(static_cast<float>(nearest)) > nearest + 1e-12 ? 1 : 0;
    }
  }
  EXPECT_GT(rounded_count, 100) << "the nearest float must be the wrong one here";
}

// Agents, renderers and the coordinator take one box or many: they must agree to the bit. The
// checksum is that of footprints computed one by one in plain C++, corner by corner.
TEST(FootprintTest, OneBoxAndManyHaveTheSameBitsOnEveryInstructionSet) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    Random random(11);
    std::int64_t on_screen = 0;
    std::int64_t outside = 0;
    std::int64_t everything = 0;
    std::string bytes;
    for (int round = 0; round < 150; ++round) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, RandomView(92, &random));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const volume::BlockLayout layout,
          volume::BlockLayout::Make(view.geometry().sample_dims,
                                    {1 + random.Index(16), 8, 1 + random.Index(16)}));
      const std::vector<volume::BlockId> ids = SomeBlocks(layout, &random);
      std::vector<Footprint> footprints(ids.size());
      view.FootprintsOf(layout, ids, absl::MakeSpan(footprints));
      for (std::size_t i = 0; i < ids.size(); ++i) {
        const Footprint one = view.FootprintOf(layout, ids[i]);
        ASSERT_EQ(footprints[i].rect, one.rect) << "round " << round << ", block " << ids[i];
        ASSERT_EQ(std::bit_cast<std::uint32_t>(footprints[i].nearest_depth),
                  std::bit_cast<std::uint32_t>(one.nearest_depth))
            << "round " << round << ", block " << ids[i];
        for (const int edge :
             {one.rect.begin_x, one.rect.begin_y, one.rect.end_x, one.rect.end_y}) {
          base::AppendLittleEndian(edge, &bytes);
        }
        base::AppendLittleEndian(one.nearest_depth, &bytes);
        (one.rect.empty() ? outside : one.nearest_depth == 0 ? everything : on_screen)++;
      }
    }
    EXPECT_EQ(base::Crc32c(bytes), 3111710360U);
    EXPECT_GT(on_screen, 1000);
    EXPECT_GT(outside, 1000);
    EXPECT_GT(everything, 20);
  }
}

// Infinities and NaN, which Min and Max of processors drop, must not make a block's rectangle
// empty: a block without a rectangle is not drawn.
TEST(FootprintTest, NumbersBeyondFloatNeverHideABlock) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    // Every entry of a matrix whose blocks are on the screen, by itself.
    for (std::size_t entry = 0; entry < 16; ++entry) {
      for (const double value : {kNan, kInfinity, -kInfinity, 1e308, -1e308, 1e160, -1e160, 1e40}) {
        math::Mat4d clip_from_index;  // x and y in [-1/2, 1/2], z in [0, 1/2], w = 1
        for (std::size_t axis = 0; axis < 3; ++axis) {
          clip_from_index.At(axis, axis) = 1.0 / 16;
          clip_from_index.At(axis, 3) = axis == 2 ? 0 : -0.5;
        }
        clip_from_index.m[entry] = value;
        FootprintBatch batch;
        batch.count = FootprintBatch::kMultiple;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          for (std::size_t i = 0; i < batch.count; ++i) {
            batch.min[axis][i] = static_cast<double>(i) / 8;  // also 0: times infinity it is NaN
            batch.max[axis][i] = static_cast<double>(i) / 8 + 7;
          }
        }
        ComputeFootprints(clip_from_index, {64, 64}, {0, 0, 64, 64}, &batch);
        for (std::size_t i = 0; i < batch.count; ++i) {
          EXPECT_EQ(batch.outcome[i], FootprintBatch::kWholePicture)
              << "entry " << entry << " is " << value << ", box " << i;
        }
      }
    }
  }
  const volume::GridGeometry geometry = MakeGeometry();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const View view, View::Make(MakeDefaultCamera(geometry.Bounds()), {64, 48}, geometry));
  for (const double far : {kInfinity, 1.7e308, 1e160, 1e40}) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        math::Vec3d low{31, 15, 20};
        math::Vec3d high{33, 17, 22};
        (sign < 0 ? low : high)[axis] = sign * far;
        const Footprint footprint = view.FootprintOf(low, high);
        EXPECT_EQ(footprint.rect, (PixelRect{0, 0, 64, 48})) << axis << ' ' << sign * far;
        EXPECT_EQ(footprint.nearest_depth, 0) << axis << ' ' << sign * far;
      }
    }
  }
}

TEST(ViewTest, ProjectionsThatFloatDoesNotHoldAreRefusedWithTheLimit) {
  const volume::GridGeometry geometry = MakeGeometry();
  for (const double opening : {1e-300, 1e-40}) {
    for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
      Camera camera = MakeDefaultCamera(geometry.Bounds());
      camera.projection = projection;
      camera.fov_y_radians = opening;
      camera.view_height = opening;
      EXPECT_THAT(View::Make(camera, {64, 48}, geometry),
                  StatusIs(absl::StatusCode::kInvalidArgument,
                           ::testing::AllOf(::testing::HasSubstr("2^120"),
                                            ::testing::HasSubstr(absl::StrCat(opening)))));
    }
  }
}

TEST(FootprintTest, ARegionCutsTheWholesRectanglesAndChangesNoDepth) {
  Random random(23);
  std::int64_t cut = 0;
  for (int round = 0; round < 100; ++round) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View whole, RandomView(92, &random));
    const Viewport& size = whole.viewport();
    const int x = random.Index(size.width_px);
    const int y = random.Index(size.height_px);
    const Region region{x, y, 1 + random.Index(size.width_px - x),
                        1 + random.Index(size.height_px - y)};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View part,
                                  View::Make(whole.camera(), size, whole.geometry(), region));
    ASSERT_EQ(part.clip_from_index().m, whole.clip_from_index().m);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const volume::BlockLayout layout,
        volume::BlockLayout::Make(whole.geometry().sample_dims, {8, 8, 8}));
    const std::vector<volume::BlockId> ids = SomeBlocks(layout, &random);
    std::vector<Footprint> footprints(ids.size());
    part.FootprintsOf(layout, ids, absl::MakeSpan(footprints));
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const Footprint whole_footprint = whole.FootprintOf(layout, ids[i]);
      PixelRect expected{std::max(whole_footprint.rect.begin_x - x, 0),
                         std::max(whole_footprint.rect.begin_y - y, 0),
                         std::min(whole_footprint.rect.end_x - x, region.width_px),
                         std::min(whole_footprint.rect.end_y - y, region.height_px)};
      expected = expected.empty() ? PixelRect() : expected;
      ASSERT_EQ(footprints[i].rect, expected) << "round " << round << ", block " << ids[i];
      ASSERT_EQ(part.FootprintOf(layout, ids[i]).rect, expected);
      ASSERT_EQ(footprints[i].nearest_depth, whole_footprint.nearest_depth);
      cut += expected.empty() || expected == whole_footprint.rect ? 0 : 1;
    }
  }
  EXPECT_GT(cut, 500);
}

TEST(ViewTest, RegionsOutsideTheViewportAreRefused) {
  const volume::GridGeometry geometry = MakeGeometry();
  const Camera camera = MakeDefaultCamera(geometry.Bounds());
  for (const Region& region :
       {Region{0, 0, 0, 1}, Region{-1, 0, 1, 1}, Region{64, 0, 1, 1}, Region{0, 1, 1, 48},
        Region{1, 0, std::numeric_limits<int>::max(), 1}}) {
    EXPECT_THAT(View::Make(camera, {64, 48}, geometry, region),
                StatusIs(absl::StatusCode::kInvalidArgument, ::testing::HasSubstr("region")));
  }
  EXPECT_THAT(View::Make(camera, {65537, 48}, geometry, Region{0, 0, 1, 1}),
              StatusIs(absl::StatusCode::kInvalidArgument, ::testing::HasSubstr("65536")));
  ISOSCOPE_EXPECT_OK(View::Make(camera, {65536, 48}, geometry, Region{65535, 47, 1, 1}));
}

TEST(FootprintTest, RectanglesAreTightAwayFromTheEye) {
  // Conservative must not mean useless: at most one pixel a side more than the exact projection.
  Random random(3);
  const volume::GridGeometry geometry = MakeGeometry();
  Camera camera = MakeDefaultCamera(geometry.Bounds());
  Azimuth(0.5, &camera);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View view, View::Make(camera, {1024, 1024}, geometry));
  for (int i = 0; i < 1000; ++i) {
    const math::Vec3d low = random.Point({0, 0, 0}, MaxIndex(geometry) - math::Vec3d{8, 8, 8});
    const math::Box3d box{low, low + math::Vec3d{8, 8, 8}};
    math::Box3d pixels;
    for (const math::Vec3d& corner : box.Corners()) {
      const math::Vec3d ndc = Ndc(view.clip_from_index(), corner);
      pixels.Add({512 * (ndc.x + 1), 512 * (1 - ndc.y), 0});
    }
    const Footprint footprint = view.FootprintOf(box.min, box.max);
    ASSERT_GE(footprint.rect.begin_x, pixels.min.x - 1);
    ASSERT_LE(footprint.rect.end_x, pixels.max.x + 1);
    ASSERT_GE(footprint.rect.begin_y, pixels.min.y - 1);
    ASSERT_LE(footprint.rect.end_y, pixels.max.y + 1);
  }
}

// A level of the volume has the planes of level 0, so a world point has one depth on every grid.
TEST(ViewTest, AnotherGridShowsTheSameWorld) {
  const volume::GridGeometry geometry = MakeGeometry();
  volume::GridGeometry coarse = geometry;
  coarse.sample_dims = {16, 8, 12};
  coarse.spacing = geometry.spacing * 4.0;
  coarse.origin = math::TransformPoint(geometry.world_from_index(), {1.5, 1.5, 1.5});
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    Camera camera = MakeDefaultCamera(geometry.Bounds());
    camera.projection = projection;
    camera.view_height = 30;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const View view, View::Make(camera, {320, 200}, geometry, Region{10, 20, 100, 50}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View of_coarse, view.OnGrid(coarse));
    EXPECT_EQ(of_coarse.geometry(), coarse);
    EXPECT_EQ(of_coarse.near_distance(), view.near_distance());
    EXPECT_EQ(of_coarse.far_distance(), view.far_distance());
    EXPECT_EQ(of_coarse.clip_from_world(), view.clip_from_world());
    EXPECT_EQ(of_coarse.region(), view.region());
    for (const math::Vec3d& index : math::Box3d{{0, 0, 0}, {15, 7, 11}}.Corners()) {
      const math::Vec3d world = math::TransformPoint(coarse.world_from_index(), index);
      const math::Vec3d a = Ndc(of_coarse.clip_from_index(), index);
      const math::Vec3d b = Ndc(view.clip_from_world(), world);
      EXPECT_NEAR(math::Length(a - b), 0, 1e-9);
    }
    // The same grid gives the same bits.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const View again, of_coarse.OnGrid(geometry));
    EXPECT_EQ(again.clip_from_index(), view.clip_from_index());
    EXPECT_EQ(again.index_from_world(), view.index_from_world());
  }
}

}  // namespace
}  // namespace isoscope::view
