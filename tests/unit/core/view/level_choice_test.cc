// The level of a frame, against closed forms, and the nearest point against all corners of what a clip
// box leaves of a volume.

#include "core/view/level_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/math/matrix.h"
#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Samples in [0, 63]^3 world units; the eye on +z.
volume::GridGeometry Cube() {
  volume::GridGeometry grid;
  grid.sample_dims = {64, 64, 64};
  return grid;
}

Camera EyeAt(double z) {
  Camera camera;
  camera.eye = {31.5, 31.5, z};
  camera.target = {31.5, 31.5, z - 1};
  camera.fov_y_radians = 90 * kDegree;
  return camera;
}

View MakeView(const Camera& camera, const volume::GridGeometry& grid,
              const Viewport& viewport = {.width_px = 200, .height_px = 100},
              const std::optional<Region>& region = std::nullopt) {
  absl::StatusOr<View> view = View::Make(camera, viewport, grid, region);
  EXPECT_TRUE(view.ok()) << view.status();
  return *std::move(view);
}

math::Box3d BoxOf(const math::Vec3d& min, const math::Vec3d& max) { return {min, max}; }

TEST(PixelsPerUnitTest, PerspectiveCountsTheNearestFaceOfTheVolume) {
  // 90 degrees: at distance d the picture is 2 d high. The face z = 63 is 37 away.
  const View view = MakeView(EyeAt(100), Cube());
  EXPECT_NEAR(PixelsPerUnit(view, std::nullopt), 100 / (2 * 37.0), 1e-9);
}

TEST(PixelsPerUnitTest, ParallelDoesNotCountTheDistance) {
  for (const double z : {70.0, 100.0, 1000.0}) {
    Camera camera = EyeAt(z);
    camera.projection = Projection::kOrthographic;
    camera.view_height = 40;
    EXPECT_NEAR(PixelsPerUnit(MakeView(camera, Cube()), std::nullopt), 100 / 40.0, 1e-9);
  }
}

TEST(PixelsPerUnitTest, AClipBoxMovesTheNearestPoint) {
  const View view = MakeView(EyeAt(100), Cube());
  EXPECT_NEAR(PixelsPerUnit(view, BoxOf({0, 0, 0}, {63, 63, 20})), 100 / (2 * 80.0), 1e-6);
  // It takes nothing away in front.
  const double whole = PixelsPerUnit(view, std::nullopt);
  EXPECT_NEAR(PixelsPerUnit(view, BoxOf({0, 0, 0}, {63, 63, 63})), whole, 1e-6);
  EXPECT_NEAR(PixelsPerUnit(view, BoxOf({-1e300, -1e300, -1e300}, {1e300, 1e300, 1e300})), whole,
              1e-6);
  EXPECT_NEAR(PixelsPerUnit(view, BoxOf({10, 10, 10}, {11, 11, 70})), whole, 1e-6);
}

TEST(PixelsPerUnitTest, NothingIsLeftOutsideOrBehindTheEye) {
  const View view = MakeView(EyeAt(100), Cube());
  EXPECT_EQ(PixelsPerUnit(view, BoxOf({100, 0, 0}, {120, 63, 63})), 0);
  EXPECT_EQ(PixelsPerUnit(view, BoxOf({1e300, 0, 0}, {1e300, 63, 63})), 0);
  EXPECT_EQ(PixelsPerUnit(MakeView(EyeAt(-10), Cube()), std::nullopt), 0);
  // The eye is in the volume, and the box behind the eye.
  EXPECT_EQ(PixelsPerUnit(MakeView(EyeAt(20), Cube()), BoxOf({0, 0, 30}, {63, 63, 63})), 0);
}

TEST(PixelsPerUnitTest, InsideTheVolumeItIsThatOfTheNearPlane) {
  const View view = MakeView(EyeAt(20), Cube());
  EXPECT_NEAR(PixelsPerUnit(view, std::nullopt), 100 / (2 * view.near_distance()), 1e-6);
  EXPECT_TRUE(std::isfinite(PixelsPerUnit(view, std::nullopt)));
}

TEST(PixelsPerUnitTest, ARegionHasThatOfTheWhole) {
  const Viewport viewport{.width_px = 200, .height_px = 100};
  const View whole = MakeView(EyeAt(100), Cube(), viewport);
  const View region = MakeView(EyeAt(100), Cube(), viewport, Region{150, 80, 7, 9});
  EXPECT_EQ(PixelsPerUnit(whole, std::nullopt), PixelsPerUnit(region, std::nullopt));
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : seed_(seed) {}
  double Uniform(double low, double high) {
    return low + (high - low) * base::RandomUnit(seed_, counter_++);
  }
  math::Vec3d Point(double low, double high) {
    const double x = Uniform(low, high);
    const double y = Uniform(low, high);
    return {x, y, Uniform(low, high)};
  }

 private:
  std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

// Points p with Dot(normal, p) >= offset.
struct Plane {
  math::Vec3d normal;
  double offset = 0;
};

// Returns the least distance along `forward` of the corners of what all planes keep: the points where
// three of them meet, and that no other leaves out. Infinity: there is no corner.
double LeastOfAllCorners(const std::vector<Plane>& planes, const math::Vec3d& eye,
                         const math::Vec3d& forward) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < planes.size(); ++i) {
    for (std::size_t j = i + 1; j < planes.size(); ++j) {
      for (std::size_t k = j + 1; k < planes.size(); ++k) {
        const math::Mat3d rows =
            math::Transposed({{planes[i].normal, planes[j].normal, planes[k].normal}});
        if (std::abs(math::Determinant(rows)) < 1e-9) {
          continue;
        }
        const math::Vec3d corner =
            math::Inverted(rows) *
            math::Vec3d{planes[i].offset, planes[j].offset, planes[k].offset};
        const bool is_kept = std::all_of(planes.begin(), planes.end(), [&](const Plane& plane) {
          return math::Dot(plane.normal, corner) >= plane.offset - 1e-7;
        });
        if (is_kept) {
          least = std::min(least, math::Dot(corner - eye, forward));
        }
      }
    }
  }
  return least;
}

// The volume is turned and sheared, and the clip box cuts it anywhere.
TEST(PixelsPerUnitTest, TheNearestPointIsTheNearestOfAllCorners) {
  int with_corners = 0;
  int cut = 0;
  int without = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE(absl::StrCat("seed ", seed));
    Random random(seed);
    volume::GridGeometry grid;
    grid.sample_dims = {17, 33, 9};
    grid.spacing = {1, 0.5, 2};
    grid.origin = random.Point(-5, 5);
    for (math::Vec3d& column : grid.direction.columns) {
      column = math::Normalized(random.Point(-1, 1));
    }
    if (std::abs(math::Determinant(grid.direction)) < 0.3) {
      continue;
    }
    const math::Box3d bounds = grid.Bounds();
    math::Box3d clip_box;
    clip_box.Add(bounds.Center() + random.Point(-12, 12));
    clip_box.Add(bounds.Center() + random.Point(-12, 12));
    Camera camera;
    camera.eye = bounds.Center() + math::Normalized(random.Point(-1, 1)) * 60.0;
    camera.target = bounds.Center() + random.Point(-4, 4);
    camera.up = random.Point(-1, 1);
    camera.fov_y_radians = 40 * kDegree;
    const View view = MakeView(camera, grid);

    std::vector<Plane> planes;
    const math::Mat4d to_index = grid.index_from_world();
    for (int axis = 0; axis < 3; ++axis) {
      math::Vec3d unit;
      unit[axis] = 1;
      planes.push_back({unit, clip_box.min[axis]});
      planes.push_back({-unit, -clip_box.max[axis]});
      const auto row = static_cast<std::size_t>(axis);
      const math::Vec3d normal{to_index.At(row, 0), to_index.At(row, 1), to_index.At(row, 2)};
      const double shift = to_index.At(row, 3);
      planes.push_back({normal, -shift});
      planes.push_back({-normal, shift - static_cast<double>(grid.sample_dims[axis] - 1)});
    }
    const double least = LeastOfAllCorners(planes, camera.eye, view.forward());
    const double pixels = PixelsPerUnit(view, clip_box);
    if (std::isinf(least)) {
      EXPECT_EQ(pixels, 0);
      ++without;
      continue;
    }
    ++with_corners;
    ASSERT_GT(pixels, 0);
    EXPECT_NEAR(1 / (pixels * view.image_plane().pixel_size), least, 1e-5);
    const double whole = 1 / (PixelsPerUnit(view, std::nullopt) * view.image_plane().pixel_size);
    cut += least > whole + 1e-3 ? 1 : 0;
  }
  EXPECT_GT(with_corners, 150);
  EXPECT_GT(cut, 100);
  EXPECT_GT(without, 5);
}

TEST(WorldSpacingTest, CountsTheLengthOfTheAxes) {
  volume::GridGeometry grid = Cube();
  grid.spacing = {1, 2, 0.5};
  grid.direction.columns = {math::Vec3d{0, 3, 0}, math::Vec3d{1, 0, 0}, math::Vec3d{0, 0, -1}};
  EXPECT_EQ(WorldSpacing(grid), (math::Vec3d{3, 2, 0.5}));
  EXPECT_EQ(SpacingPx(grid, 4), 12);
}

TEST(CoarsestLevelTest, IsTheLastOneWhoseSamplesAreCloseEnough) {
  const volume::GridGeometry grid = Cube();
  // A sample of level l covers 0.3 * 2^l pixels.
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 0.1, 5), 0);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 0.3, 5), 0);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 0.6, 5), 1);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, std::nextafter(0.6, 0.0), 5), 0);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 1.1, 5), 1);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 1.2, 5), 2);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 1e9, 5), 5);
  EXPECT_EQ(CoarsestLevel(grid, 0.3, 1e9, 0), 0);
  EXPECT_EQ(CoarsestLevel(grid, 0, 1e-300, 3), 3);  // nothing shows
}

TEST(CoarsestLevelTest, IsThatOfALinearSearchOverTheLevels) {
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Random random(seed);
    volume::GridGeometry grid = Cube();
    grid.spacing = random.Point(0.1, 3);
    const double pixels = random.Uniform(0.01, 20);
    const double limit = random.Uniform(0.01, 40);
    int expected = 0;
    for (int level = 0; level <= 6; ++level) {
      if (SpacingPx(grid, pixels) * std::ldexp(1.0, level) <= limit) {
        expected = level;
      }
    }
    EXPECT_EQ(CoarsestLevel(grid, pixels, limit, 6), expected) << "seed " << seed;
  }
}

}  // namespace
}  // namespace isoscope::view
