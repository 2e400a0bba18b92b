#include "clients/cpp/request/camera_flags.h"

#include <numbers>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;

constexpr double kRadiansPerDegree = std::numbers::pi / 180;

math::Box3d Bounds() {
  math::Box3d bounds;
  bounds.Add({-1, -2, -3});
  bounds.Add({5, 4, 9});
  return bounds;
}

TEST(CameraFlagsTest, NothingGivenIsTheDefaultCamera) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera, ResolveCamera({}, Bounds()));
  EXPECT_EQ(camera, view::MakeDefaultCamera(Bounds()));
}

TEST(CameraFlagsTest, PlacedCameraTakesWhatIsGivenAndTheRestFromTheDefault) {
  const view::Camera standard = view::MakeDefaultCamera(Bounds());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::Camera placed,
      ResolveCamera({.eye = math::Vec3d{10, 0, 0}, .fov_y_degrees = 60}, Bounds()));
  EXPECT_EQ(placed.eye, (math::Vec3d{10, 0, 0}));
  EXPECT_EQ(placed.target, standard.target);
  EXPECT_EQ(placed.up, standard.up);
  EXPECT_DOUBLE_EQ(placed.fov_y_radians, std::numbers::pi / 3);
}

TEST(CameraFlagsTest, TurnedCameraIsAzimuthThenElevationThenUpThenZoom) {
  view::Camera expected = view::MakeDefaultCamera(Bounds());
  view::Azimuth(30 * kRadiansPerDegree, &expected);
  view::Elevation(20 * kRadiansPerDegree, &expected);
  view::OrthogonalizeUp(&expected);
  view::Zoom(1.5, &expected);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::Camera camera,
      ResolveCamera({.azimuth_degrees = 30, .elevation_degrees = 20, .zoom = 1.5}, Bounds()));
  EXPECT_EQ(camera, expected);
  EXPECT_NE(camera.up, (math::Vec3d{0, 1, 0}));
}

TEST(CameraFlagsTest, AHeightMakesTheProjectionParallelHoweverTheCameraIsPlaced) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::Camera turned,
      ResolveCamera({.azimuth_degrees = 30, .zoom = 2, .orthographic_height = 12}, Bounds()));
  EXPECT_EQ(turned.projection, view::Projection::kOrthographic);
  EXPECT_EQ(turned.view_height, 6);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera perspective,
                                ResolveCamera({.azimuth_degrees = 30}, Bounds()));
  EXPECT_EQ(turned.eye, perspective.eye);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::Camera placed,
      ResolveCamera({.eye = math::Vec3d{10, 0, 0}, .orthographic_height = 12}, Bounds()));
  EXPECT_EQ(placed.view_height, 12);
  EXPECT_THAT(CheckUsage(CameraFlags{.fov_y_degrees = 30, .orthographic_height = 12}),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       ::testing::HasSubstr("can't be used with --fov-y")));
}

TEST(CameraFlagsTest, OrbitTurnsFrameByFrameAndLeavesTheFirstAlone) {
  const view::Camera camera = view::MakeDefaultCamera(Bounds());
  EXPECT_EQ(OrbitCamera(camera, 7, 0), camera);
  EXPECT_EQ(OrbitCamera(camera, 0, 5), camera);
  view::Camera expected = camera;
  view::Azimuth(21 * kRadiansPerDegree, &expected);
  EXPECT_EQ(OrbitCamera(camera, 7, 3), expected);
}

TEST(CameraFlagsTest, TheTwoKindsExcludeEachOther) {
  const std::vector<CameraFlags> placed = {{.eye = math::Vec3d{1, 2, 3}},
                                           {.target = math::Vec3d{1, 2, 3}},
                                           {.up = math::Vec3d{0, 0, 1}},
                                           {.fov_y_degrees = 40}};
  for (CameraFlags flags : placed) {
    ISOSCOPE_EXPECT_OK(CheckUsage(flags));
    flags.azimuth_degrees = 1;
    EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags)));
    flags.azimuth_degrees.reset();
    flags.elevation_degrees = 1;
    EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags)));
    flags.elevation_degrees.reset();
    flags.zoom = 2;
    EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags)));
  }
  ISOSCOPE_EXPECT_OK(
      CheckUsage(CameraFlags{.azimuth_degrees = 1, .elevation_degrees = 2, .zoom = 3}));
}

TEST(CameraFlagsTest, CamerasThatCannotSeeAreRefused) {
  const math::Vec3d center = Bounds().Center();
  EXPECT_THAT(ResolveCamera({.eye = center}, Bounds()),
              StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(ResolveCamera({.eye = center + math::Vec3d{0, 5, 0}}, Bounds()),
              StatusIs(absl::StatusCode::kInvalidArgument));
  // Zooming out to half a turn or more.
  EXPECT_THAT(ResolveCamera({.zoom = 0.1}, Bounds()), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::client
