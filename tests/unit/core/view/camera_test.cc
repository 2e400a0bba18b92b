#include "core/view/camera.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180;

Camera MakeValid() {
  Camera camera;
  camera.eye = {0, 0, 10};
  camera.fov_y_radians = 0.5;
  camera.view_height = 2;
  return camera;
}

void ExpectNear(const math::Vec3d& actual, const math::Vec3d& expected) {
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(actual[axis], expected[axis], 1e-12 * 50) << "axis " << axis;
  }
}

// Numbers of VTK 9.1: vtkRenderer::ResetCamera on these bounds, then vtkCamera's methods in turn.
TEST(CameraTest, TurnsAsVtkDoes) {
  math::Box3d bounds;
  bounds.Add({0, -5, 2});
  bounds.Add({10, 15, 8});
  Camera camera = MakeDefaultCamera(bounds);
  EXPECT_EQ(camera.target, (math::Vec3d{5, 5, 5}));
  EXPECT_EQ(camera.up, (math::Vec3d{0, 1, 0}));
  EXPECT_DOUBLE_EQ(camera.fov_y_radians, 30 * kDegree);
  EXPECT_NEAR(camera.view_height, 2 * 11.575836902790225, 1e-12);
  ExpectNear(camera.eye, {5, 5, 49.725599301260551});
  ISOSCOPE_EXPECT_OK(Validate(camera));

  Azimuth(30 * kDegree, &camera);
  ExpectNear(camera.eye, {27.362799650630272, 5, 43.733505194375184});
  Elevation(20 * kDegree, &camera);
  ExpectNear(camera.eye, {26.014157811810954, 20.29705588334356, 41.397589008327017});
  EXPECT_EQ(camera.up, (math::Vec3d{0, 1, 0}));
  OrthogonalizeUp(&camera);
  ExpectNear(camera.up, {-0.1710100716628343, 0.93969262078590843, -0.2961981327260238});
  Azimuth(7 * kDegree, &camera);
  ExpectNear(camera.eye, {30.577948311914756, 20.183033948454895, 38.400947189114284});
  Zoom(1.5, &camera);
  EXPECT_NEAR(camera.fov_y_radians, 20 * kDegree, 1e-15);
}

// As above, with an up that is neither a unit vector nor perpendicular to the view direction.
TEST(CameraTest, TurnsAsVtkDoesWithAnObliqueUp) {
  Camera camera;
  camera.eye = {3, -4, 12};
  camera.target = {1, 2, 3};
  camera.up = {0.3, 0.2, 0.9};
  camera.fov_y_radians = 40 * kDegree;
  Azimuth(-50 * kDegree, &camera);
  Elevation(35 * kDegree, &camera);
  ExpectNear(camera.eye, {2.8525836845494386, 3.1821478391883056, 13.778240124345146});
  OrthogonalizeUp(&camera);
  ExpectNear(camera.up, {0.80289962111574342, 0.56170077906599736, -0.19961070414395918});
}

TEST(CameraTest, PositiveAzimuthMovesRightAndPositiveElevationUp) {
  Camera camera = MakeValid();
  Azimuth(0.1, &camera);
  EXPECT_GT(camera.eye.x, 0);
  camera = MakeValid();
  Elevation(0.1, &camera);
  EXPECT_GT(camera.eye.y, 0);
}

TEST(CameraTest, AFullTurnComesBack) {
  Camera camera = MakeValid();
  for (int i = 0; i < 36; ++i) {
    Azimuth(10 * kDegree, &camera);
  }
  ExpectNear(camera.eye, {0, 0, 10});
}

TEST(CameraTest, ZoomDividesTheHeightOfAnOrthographicView) {
  Camera camera = MakeValid();
  camera.projection = Projection::kOrthographic;
  Zoom(4, &camera);
  EXPECT_EQ(camera.view_height, 0.5);
  EXPECT_EQ(camera.fov_y_radians, 0.5);
}

TEST(CameraTest, ABoxWithoutSizeStillHasACamera) {
  math::Box3d bounds;
  bounds.Add({1, 2, 3});
  ISOSCOPE_EXPECT_OK(Validate(MakeDefaultCamera(bounds)));
}

TEST(CameraTest, ValidationNamesTheFieldAndItsValue) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const auto expect_invalid = [](const Camera& camera, const std::string& what) {
    EXPECT_THAT(Validate(camera), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  ISOSCOPE_EXPECT_OK(Validate(MakeValid()));
  Camera camera = MakeValid();
  camera.eye.y = kNan;
  expect_invalid(camera, "eye 0, nan, 10");
  camera = MakeValid();
  camera.target.x = kInf;
  expect_invalid(camera, "target inf, 0, 0");
  camera = MakeValid();
  camera.up.z = -kInf;
  expect_invalid(camera, "up 0, 1, -inf");
  camera = MakeValid();
  camera.target = camera.eye;
  expect_invalid(camera, "eye and target are both 0, 0, 10");
  camera = MakeValid();
  camera.eye.z = 1e200;
  expect_invalid(camera, "too far apart");
  camera = MakeValid();
  camera.up = {0, 0, 0};
  expect_invalid(camera, "up 0, 0, 0 has length 0");
  camera = MakeValid();
  camera.up = {0, 0, -3};
  expect_invalid(camera, "up 0, 0, -3 is parallel to the view direction 0, 0, -10");
  for (const double angle : {0.0, -1.0, std::numbers::pi, kNan}) {
    camera = MakeValid();
    camera.fov_y_radians = angle;
    expect_invalid(camera, "vertical angle");
  }
  for (const double height : {0.0, -1.0, kInf, kNan}) {
    camera = MakeValid();
    camera.projection = Projection::kOrthographic;
    camera.view_height = height;
    expect_invalid(camera, "view height");
  }
  // Each projection uses its own number alone.
  camera = MakeValid();
  camera.view_height = 0;
  ISOSCOPE_EXPECT_OK(Validate(camera));
}

TEST(ViewportTest, SidesAreLimited) {
  ISOSCOPE_EXPECT_OK(Validate(Viewport{1, kMaxViewportPx}));
  EXPECT_THAT(Validate(Viewport{0, 5}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("viewport of 0 x 5 pixels")));
  EXPECT_THAT(Validate(Viewport{5, kMaxViewportPx + 1}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("16384")));
}

}  // namespace
}  // namespace isoscope::view
