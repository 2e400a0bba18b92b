#include "core/rpc/frame_convert.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/rpc/proto_convert.h"
#include "core/view/camera.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

isoscope::v1::RenderIsosurfaceRequest MakeRequest() {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(60);
  request.mutable_viewport()->set_width_px(40);
  request.mutable_viewport()->set_height_px(30);
  return request;
}

TEST(FrameSpecFromProtoTest, UnsetMembersTakeTheirDefaults) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(MakeRequest()));
  frame::FrameSpec expected;
  expected.surfaces = {{.isovalue = 60, .appearance = {}}};
  expected.viewport = {.width_px = 40, .height_px = 30};
  EXPECT_EQ(spec, expected);
  EXPECT_FALSE(spec.camera.has_value());
  EXPECT_EQ(spec.background_color, (image::Rgba8{0, 0, 0, 255}));
}

TEST(FrameSpecFromProtoTest, EveryMemberOfTheRequestArrives) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  *request.mutable_camera() = ToProto(view::MakeDefaultCamera({{0, 0, 0}, {4, 5, 6}}));
  request.set_culling(isoscope::v1::CULLING_MASK);
  *request.mutable_base_color() = ToProto(image::Rgba8{1, 2, 3, 255});
  *request.mutable_background_color() = ToProto(image::Rgba8{4, 5, 6, 7});
  request.set_ray_seed(-9);
  *request.mutable_region() = ToProto(view::Region{3, 4, 5, 6});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.surfaces[0].appearance.base_color, (image::Rgba8{1, 2, 3, 255}));
  EXPECT_EQ(spec.background_color, (image::Rgba8{4, 5, 6, 7}));
  EXPECT_EQ(spec.culling, frame::Culling::kMask);
  EXPECT_EQ(spec.region, (view::Region{3, 4, 5, 6}));
  EXPECT_EQ(frame::ImageSizeOf(spec), (view::Viewport{5, 6}));
  EXPECT_EQ(spec.ray_seed, static_cast<std::uint64_t>(-9));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera,
                                CameraFromProto(request.camera(), "camera"));
  EXPECT_EQ(spec.camera, camera);
}

TEST(FrameSpecFromProtoTest, WrongMembersAreNamedWithTheirValue) {
  const auto expect = [](const isoscope::v1::RenderIsosurfaceRequest& request, const char* what) {
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(std::numeric_limits<double>::infinity());
  expect(request, "isovalue");
  request = MakeRequest();
  request.clear_viewport();
  expect(request, "viewport is not set");
  request = MakeRequest();
  request.mutable_base_color()->set_alpha(0.5F);
  expect(request, "base_color.alpha is 0.5");
  request = MakeRequest();
  request.mutable_camera()->mutable_eye()->set_x(1);
  expect(request, "camera");
  request = MakeRequest();
  request.set_culling(static_cast<isoscope::v1::Culling>(12));
  expect(request, "culling");
  request = MakeRequest();
  request.GetReflection()->MutableUnknownFields(&request)->AddVarint(90, 1);
  expect(request, "number 90");
}

TEST(FrameSpecFromProtoTest, OnlyTheViewportOfARegionMayBeLargerThanAPicture) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_viewport()->set_width_px(view::kMaxWholeViewportPx);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("viewport.width_px is 65536"), HasSubstr("16384"))));
  *request.mutable_region() = ToProto(view::Region{65535, 0, 1, 30});
  EXPECT_THAT(FrameSpecFromProto(request), IsOk());
  request.mutable_region()->set_width_px(2);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("region.width_px is 2"), HasSubstr("[1, 1]"))));
}

TEST(ResolveCameraTest, AgentsReadTheSameBitsFromTheMessage) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  ISOSCOPE_ASSERT_OK(ResolveCamera({{0, 0, 0}, {3, 1, 2}}, &request, &spec));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec of_agent, FrameSpecFromProto(request));
  EXPECT_TRUE(of_agent.camera.has_value());
  EXPECT_EQ(of_agent, spec);
}

TEST(ResolveCameraTest, ACameraThatIsSetStays) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  *request.mutable_camera() = ToProto(view::MakeDefaultCamera({{0, 0, 0}, {4, 5, 6}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  const frame::FrameSpec before = spec;
  ISOSCOPE_ASSERT_OK(ResolveCamera({{0, 0, 0}, {300, 1, 2}}, &request, &spec));
  EXPECT_EQ(spec, before);
}

TEST(PictureRevisionConvertTest, BothWaysGiveTheSame) {
  for (const frame::PictureRevision& revision :
       {frame::PictureRevision{.number = 2, .back_end = frame::BackEnd::kCpu, .driver = ""},
        frame::PictureRevision{.number = 7, .back_end = frame::BackEnd::kEgl, .driver = "x, y"}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::PictureRevision back,
                                  PictureRevisionFromProto(ToProto(revision), "r"));
    EXPECT_EQ(back, revision);
  }
}

TEST(PictureRevisionConvertTest, AgentsThatTellNoneAreRefused) {
  EXPECT_THAT(PictureRevisionFromProto({}, "picture_revision"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("picture_revision.number is 0"), HasSubstr("older"))));
  isoscope::internal::v1::PictureRevision unknown = ToProto(frame::PictureRevision());
  unknown.set_back_end(static_cast<isoscope::internal::v1::PictureRevision::BackEnd>(9));
  EXPECT_THAT(PictureRevisionFromProto(unknown, "picture_revision"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("back_end is 9")));
}

}  // namespace
}  // namespace isoscope::rpc
