#include "clients/cpp/request/view_flags.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "clients/cpp/request/camera_file.h"
#include "core/cli/usage.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/first_look.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;
using view::NamedView;

v1::Dataset DatasetOf(const std::string& patient_frame) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {10, 20, 30};
  v1::Dataset dataset;
  *dataset.mutable_geometry() = wire::ToProto(geometry);
  dataset.set_patient_frame(patient_frame);
  return dataset;
}

math::Box3d Bounds() {
  math::Box3d bounds;
  bounds.Add({0, 0, 0});
  bounds.Add({9, 19, 29});
  return bounds;
}

TEST(ViewFlagsTest, NothingGivenIsTheDefaultCamera) {
  for (const char* frame : {"", "LPS"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, ResolveView({}, {}, DatasetOf(frame)));
    EXPECT_EQ(camera.SerializeAsString(),
              wire::ToProto(view::MakeDefaultCamera(Bounds())).SerializeAsString());
  }
}

TEST(ViewFlagsTest, AViewIsTurnedOnFromThere) {
  const CameraFlags turned{.azimuth_degrees = 30, .elevation_degrees = 10, .zoom = 2};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, ResolveView({.view = NamedView::kAnterior},
                                                                     turned, DatasetOf("LPS")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::Camera anterior,
      view::MakeNamedCamera(NamedView::kAnterior, Bounds(), volume::PatientFrame()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera expected, ResolveCamera(turned, anterior));
  EXPECT_EQ(camera.SerializeAsString(), wire::ToProto(expected).SerializeAsString());
}

TEST(ViewFlagsTest, AViewOfAPatientNeedsAPatientFrame) {
  EXPECT_THAT(ResolveView({.view = NamedView::kSuperior}, {}, DatasetOf("")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no patient frame")));
  EXPECT_THAT(ResolveView({.view = NamedView::kSuperior}, {}, DatasetOf("XYZ")),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(ViewFlagsTest, ACameraFromAFileHasItsBits) {
  const TempDir directory;
  v1::Camera camera;
  camera.mutable_eye()->set_z(0.1 + 0.2);
  camera.mutable_target()->set_x(1.0 / 3);
  camera.mutable_perspective()->set_fov_y_degrees(29.999999999999996);
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(directory.Sub("c.json"), CameraToJson(camera)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const v1::Camera read,
      ResolveView({.camera_file = directory.Sub("c.json")}, {}, DatasetOf("")));
  EXPECT_EQ(read.SerializeAsString(), camera.SerializeAsString());
}

TEST(ViewFlagsTest, EachFlagOfTheCameraEndsTheFirstLook) {
  EXPECT_FALSE(HasCamera({}, {}));
  EXPECT_FALSE(HasCamera({.save_camera_file = "c.json"}, {})) << "it says where the camera goes";
  for (const ViewFlags& view :
       {ViewFlags{.view = NamedView::kFront}, ViewFlags{.fit = v1::CAMERA_FIT_VOLUME},
        ViewFlags{.camera_file = "c"}}) {
    EXPECT_TRUE(HasCamera(view, {}));
  }
  for (const CameraFlags& camera :
       {CameraFlags{.eye = math::Vec3d{1, 2, 3}}, CameraFlags{.target = math::Vec3d{1, 2, 3}},
        CameraFlags{.up = math::Vec3d{0, 0, 1}}, CameraFlags{.fov_y_degrees = 30},
        CameraFlags{.azimuth_degrees = 0}, CameraFlags{.elevation_degrees = 0},
        CameraFlags{.zoom = 1}, CameraFlags{.orthographic_height = 5}}) {
    EXPECT_TRUE(HasCamera({}, camera));
  }
}

TEST(ViewFlagsTest, TheCameraOfTheFirstLookFollowsThePatient) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera plain, FirstLookCamera(DatasetOf("")));
  EXPECT_EQ(plain.SerializeAsString(),
            wire::ToProto(wire::FirstLookCamera(Bounds(), std::nullopt)).SerializeAsString());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera patient, FirstLookCamera(DatasetOf("LPS")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera anterior,
                                ResolveView({.view = NamedView::kAnterior}, {}, DatasetOf("LPS")));
  EXPECT_EQ(patient.SerializeAsString(), anterior.SerializeAsString());
  EXPECT_THAT(FirstLookCamera(DatasetOf("XYZ")), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(ViewFlagsTest, AHeightGoesWithAViewButNotWithWhatSetsIt) {
  const CameraFlags parallel{.orthographic_height = 12};
  ISOSCOPE_EXPECT_OK(CheckUsage(ViewFlags{.view = NamedView::kTop}, parallel));
  ISOSCOPE_EXPECT_OK(CheckUsage(ViewFlags{.fit = v1::CAMERA_FIT_VOLUME}, parallel));
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(ViewFlags{.camera_file = "c.json"}, parallel)));
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(ViewFlags{.fit = v1::CAMERA_FIT_SURFACE}, parallel)));
  EXPECT_THAT(CheckUsage(ViewFlags{.fit = v1::CAMERA_FIT_CELLS}, parallel).message(),
              HasSubstr("--fit cells"));
}

TEST(ViewFlagsTest, FlagsThatPlaceTheCameraTwiceExcludeEachOther) {
  const ViewFlags views[] = {{.view = NamedView::kTop}, {.fit = v1::CAMERA_FIT_SURFACE}};
  const CameraFlags placed[] = {{.eye = math::Vec3d{1, 2, 3}},
                                {.target = math::Vec3d{1, 2, 3}},
                                {.up = math::Vec3d{0, 0, 1}},
                                {.fov_y_degrees = 40}};
  const CameraFlags turned{.azimuth_degrees = 1, .elevation_degrees = 2, .zoom = 3};
  const ViewFlags from_file{.camera_file = "c.json"};
  for (const CameraFlags& camera : placed) {
    for (const ViewFlags& view : views) {
      EXPECT_TRUE(cli::IsUsageError(CheckUsage(view, camera)));
    }
    EXPECT_TRUE(cli::IsUsageError(CheckUsage(from_file, camera)));
    ISOSCOPE_EXPECT_OK(CheckUsage(ViewFlags{.fit = v1::CAMERA_FIT_VOLUME}, camera));
  }
  for (ViewFlags view : views) {
    ISOSCOPE_EXPECT_OK(CheckUsage(view, turned));
    view.camera_file = "c.json";
    EXPECT_TRUE(cli::IsUsageError(CheckUsage(view, {})));
  }
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(from_file, turned)));
  ISOSCOPE_EXPECT_OK(CheckUsage(from_file, {}));
}

}  // namespace
}  // namespace isoscope::client
