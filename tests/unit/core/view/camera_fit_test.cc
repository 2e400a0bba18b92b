#include "core/view/camera_fit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::view {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::PatientFrame;

math::Box3d Box(const math::Vec3d& min, const math::Vec3d& max) {
  math::Box3d box;
  box.Add(min);
  box.Add(max);
  return box;
}

const math::Box3d kVolume = Box({-1, -2, -3}, {5, 4, 9});

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_NEAR(math::Length(a - b), 0, 1e-9) << a.x << " " << a.y << " " << a.z;
}

TEST(NamedCameraTest, FrontIsTheDefaultCameraBitForBit) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Camera front,
                                MakeNamedCamera(NamedView::kFront, kVolume, std::nullopt));
  EXPECT_EQ(front, MakeDefaultCamera(kVolume));
}

TEST(NamedCameraTest, EverySideLooksAtTheCentreFromOneDistance) {
  struct Row {
    NamedView name;
    math::Vec3d to_eye;
    math::Vec3d up;
  };
  const Row world[] = {
      {NamedView::kFront, {0, 0, 1}, {0, 1, 0}}, {NamedView::kBack, {0, 0, -1}, {0, 1, 0}},
      {NamedView::kLeft, {-1, 0, 0}, {0, 1, 0}}, {NamedView::kRight, {1, 0, 0}, {0, 1, 0}},
      {NamedView::kTop, {0, 1, 0}, {0, 0, -1}},  {NamedView::kBottom, {0, -1, 0}, {0, 0, 1}}};
  // In LPS, x points to the left, y to the back, and z up.
  const Row patient[] = {{NamedView::kFront, {0, 0, 1}, {0, 1, 0}},
                         {NamedView::kTop, {0, 1, 0}, {0, 0, -1}},
                         {NamedView::kAnterior, {0, -1, 0}, {0, 0, 1}},
                         {NamedView::kPosterior, {0, 1, 0}, {0, 0, 1}},
                         {NamedView::kLeft, {1, 0, 0}, {0, 0, 1}},
                         {NamedView::kRight, {-1, 0, 0}, {0, 0, 1}},
                         {NamedView::kSuperior, {0, 0, 1}, {0, -1, 0}},
                         {NamedView::kInferior, {0, 0, -1}, {0, -1, 0}}};
  const Camera standard = MakeDefaultCamera(kVolume);
  const double distance = math::Length(standard.eye - standard.target);
  const auto expect = [&](const Row& row, const std::optional<PatientFrame>& frame) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Camera camera, MakeNamedCamera(row.name, kVolume, frame));
    ISOSCOPE_EXPECT_OK(Validate(camera));
    EXPECT_EQ(camera.target, kVolume.Center());
    ExpectNear(camera.eye, camera.target + row.to_eye * distance);
    EXPECT_EQ(camera.up, row.up);
    EXPECT_EQ(camera.fov_y_radians, standard.fov_y_radians);
  };
  for (const Row& row : world) {
    expect(row, std::nullopt);
  }
  for (const Row& row : patient) {
    expect(row, PatientFrame());
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PatientFrame ras, PatientFrame::FromName("RAS"));
  expect({NamedView::kAnterior, {0, 1, 0}, {0, 0, 1}}, ras);
  expect({NamedView::kLeft, {-1, 0, 0}, {0, 0, 1}}, ras);
}

TEST(NamedCameraTest, KeysChooseTheTablesRowsInTheirOrder) {
  std::string world;
  std::string patient;
  for (const NamedViewRow& row : NamedViewTable()) {
    absl::StrAppend(&world, row.has_world() ? row.name : "", row.has_world() ? " " : "");
    absl::StrAppend(&patient, row.has_patient() ? row.name : "", row.has_patient() ? " " : "");
  }
  EXPECT_EQ(world, "front back left right top bottom ");
  EXPECT_EQ(patient, "anterior posterior left right superior inferior ");
}

TEST(NamedCameraTest, ASideOfAPatientNeedsAPatient) {
  for (const NamedView name :
       {NamedView::kAnterior, NamedView::kPosterior, NamedView::kSuperior, NamedView::kInferior}) {
    EXPECT_THAT(MakeNamedCamera(name, kVolume, std::nullopt),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no patient frame")));
  }
}

TEST(MoveToBoxTest, TheDefaultCameraOfOneBoxBecomesThatOfTheOther) {
  const math::Box3d surface = Box({1, 1, 2}, {2, 3, 2.5});
  const Camera moved = MoveToBox(MakeDefaultCamera(kVolume), kVolume, surface);
  const Camera expected = MakeDefaultCamera(surface);
  ExpectNear(moved.eye, expected.eye);
  ExpectNear(moved.target, expected.target);
  EXPECT_EQ(moved.up, expected.up);
  EXPECT_EQ(moved.fov_y_radians, expected.fov_y_radians);
  EXPECT_NEAR(moved.view_height, expected.view_height, 1e-12);
}

TEST(MoveToBoxTest, DirectionUpAngleAndFramingStay) {
  Camera camera = MakeDefaultCamera(kVolume);
  Azimuth(0.7, &camera);
  Elevation(-0.4, &camera);
  OrthogonalizeUp(&camera);
  Zoom(1.8, &camera);
  camera.target = camera.target + math::Vec3d{0.3, 0.2, -0.1};
  const math::Box3d surface = Box({4, -2, 0}, {5, -1, 1});
  const Camera moved = MoveToBox(camera, kVolume, surface);
  ExpectNear(math::Normalized(moved.target - moved.eye),
             math::Normalized(camera.target - camera.eye));
  EXPECT_EQ(moved.up, camera.up);
  EXPECT_EQ(moved.fov_y_radians, camera.fov_y_radians);
  EXPECT_NEAR(math::Length(moved.eye - surface.Center()) / surface.Radius(),
              math::Length(camera.eye - kVolume.Center()) / kVolume.Radius(), 1e-9);
  ExpectNear((moved.target - surface.Center()) * (1 / surface.Radius()),
             (camera.target - kVolume.Center()) * (1 / kVolume.Radius()));
}

// The largest share of the picture's half width or half height that a corner of the box is away from
// the middle of the picture.
double ShareOf(const Camera& camera, const Viewport& viewport, const math::Box3d& box) {
  const math::Vec3d forward = math::Normalized(camera.target - camera.eye);
  const math::Vec3d right = math::Normalized(math::Cross(forward, camera.up));
  const math::Vec3d up = math::Cross(right, forward);
  const double aspect = static_cast<double>(viewport.width_px) / viewport.height_px;
  double share = 0;
  for (const math::Vec3d& corner : box.Corners()) {
    const math::Vec3d at = corner - camera.eye;
    const double half_height = camera.projection == Projection::kOrthographic
                                   ? camera.view_height / 2
                                   : math::Dot(at, forward) * std::tan(camera.fov_y_radians / 2);
    EXPECT_GT(half_height, 0) << "behind the eye";
    share = std::max({share, std::abs(math::Dot(at, up)) / half_height,
                      std::abs(math::Dot(at, right)) / (half_height * aspect)});
  }
  return share;
}

TEST(FitToBoxTest, TheBoxTouchesTheMarginFromEveryDirectionAtEverySize) {
  const math::Box3d boxes[] = {Box({1, 1, 2}, {2, 3, 2.5}), Box({-1, 3, 3}, {4.9, 3.1, 3.1}),
                               kVolume};
  const Viewport viewports[] = {{1024, 1024}, {1440, 900}, {390, 844}, {8, 1}};
  for (const math::Box3d& box : boxes) {
    for (const Viewport& viewport : viewports) {
      for (int i = 0; i < 12; ++i) {
        Camera camera = MakeDefaultCamera(kVolume);
        Azimuth(0.7 * i, &camera);
        Elevation(0.2 * (i % 5 - 2), &camera);
        OrthogonalizeUp(&camera);
        camera.projection = i % 3 == 0 ? Projection::kOrthographic : Projection::kPerspective;
        const Camera fitted = FitToBox(camera, viewport, kVolume, box);
        ISOSCOPE_EXPECT_OK(Validate(fitted));
        EXPECT_NEAR(ShareOf(fitted, viewport, box), kTightShare, 1e-9);
        ExpectNear(math::Normalized(fitted.target - fitted.eye),
                   math::Normalized(camera.target - camera.eye));
        ExpectNear(fitted.target, box.Center());
        EXPECT_EQ(fitted.up, camera.up);
        EXPECT_EQ(fitted.fov_y_radians, camera.fov_y_radians);
      }
    }
  }
}

TEST(FitToBoxTest, NearerAndZoomedCamerasStaySo) {
  const math::Box3d box = Box({1, 1, 2}, {2, 3, 2.5});
  const Viewport viewport{640, 480};
  const Camera standard = MakeDefaultCamera(kVolume);
  const Camera fitted = FitToBox(standard, viewport, kVolume, box);
  Camera nearer = standard;
  nearer.eye = nearer.target + (nearer.eye - nearer.target) * 0.5;
  EXPECT_NEAR(math::Length(FitToBox(nearer, viewport, kVolume, box).eye - box.Center()),
              math::Length(fitted.eye - box.Center()) / 2, 1e-9);
  // Half of the angle: the box is about twice as large in the picture.
  Camera zoomed = standard;
  Zoom(2, &zoomed);
  EXPECT_NEAR(ShareOf(FitToBox(zoomed, viewport, kVolume, box), viewport, box), 2 * kTightShare,
              0.1);
  Camera parallel = standard;
  parallel.projection = Projection::kOrthographic;
  Zoom(2, &parallel);
  EXPECT_NEAR(ShareOf(FitToBox(parallel, viewport, kVolume, box), viewport, box), 2 * kTightShare,
              1e-9);
  Camera panned = standard;
  panned.target = panned.target + math::Vec3d{1, 0, 0};
  panned.eye = panned.eye + math::Vec3d{1, 0, 0};
  EXPECT_GT(FitToBox(panned, viewport, kVolume, box).target.x, box.Center().x);
}

TEST(FirstLookCameraTest, PatientsAreSeenFromAnteriorAndOthersTurned) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PatientFrame ras, PatientFrame::FromName("RAS"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Camera anterior,
                                MakeNamedCamera(NamedView::kAnterior, kVolume, ras));
  EXPECT_EQ(MakeFirstLookCamera(0.5, 0.3, kVolume, ras), anterior);
  Camera turned = MakeDefaultCamera(kVolume);
  Azimuth(0.5, &turned);
  Elevation(0.3, &turned);
  OrthogonalizeUp(&turned);
  EXPECT_EQ(MakeFirstLookCamera(0.5, 0.3, kVolume, std::nullopt), turned);
  EXPECT_GT(turned.eye.x, turned.target.x) << "from the right";
  EXPECT_GT(turned.eye.y, turned.target.y) << "and from above";
}

TEST(ClippedBoundsTest, AreInsideOfTheBoxWhereSomethingIs) {
  const auto clipped = [](const math::Vec3d& min, const math::Vec3d& max) {
    ClipRegion clip;
    clip.half_spaces.push_back({{1, 0, 0}, 4});  // planes do not count
    clip.box = Box(min, max);
    return ClippedBounds(kVolume, clip);
  };
  EXPECT_EQ(ClippedBounds(kVolume, {}), kVolume);
  EXPECT_EQ(clipped({-9, -9, -9}, {9, 9, 9}), kVolume);
  EXPECT_EQ(clipped({0, -9, 1}, {9, 3, 2}), Box({0, -2, 1}, {5, 3, 2}));
  EXPECT_EQ(clipped({0, 1, 1}, {9, 1, 2}), Box({0, 1, 1}, {5, 1, 2})) << "a plane has a size";
  EXPECT_EQ(clipped({6, 0, 0}, {9, 1, 1}), kVolume) << "beside it";
  EXPECT_EQ(clipped({1, 1, 1}, {1, 1, 1}), kVolume) << "a camera can't frame a point";
}

TEST(BoundsOfCellsTest, AllCellsAreTheVolumeAndSomeAreTheirCorners) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {5, 6, 7};
  geometry.spacing = {0.5, 2, 3};
  geometry.origin = {10, 20, 30};
  geometry.direction.columns = {math::Vec3d{0, 1, 0}, math::Vec3d{-1, 0, 0}, math::Vec3d{0, 0, 1}};
  const math::Box3d all = BoundsOfCells(geometry, {{0, 0, 0}, {4, 5, 6}});
  EXPECT_EQ(all.min, geometry.Bounds().min);
  EXPECT_EQ(all.max, geometry.Bounds().max);
  const math::Box3d some = BoundsOfCells(geometry, {{1, 2, 3}, {2, 4, 5}});
  ExpectNear(some.min, {10 - 8, 20.5, 39});
  ExpectNear(some.max, {10 - 4, 21, 45});
}

}  // namespace
}  // namespace isoscope::view
