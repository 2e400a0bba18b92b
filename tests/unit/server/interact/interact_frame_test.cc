#include "server/interact/interact_frame.h"

#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

v1::RenderIsosurfaceRequest Request() {
  v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(60);
  request.mutable_viewport()->set_width_px(1001);
  request.mutable_viewport()->set_height_px(500);
  request.mutable_camera()->mutable_eye()->set_x(3);
  request.set_samples(16);
  return request;
}

TEST(InteractFrameTest, AMovingFrameIsAJpegOfOneSampleAndOtherwiseTheSame) {
  v1::RenderIsosurfaceRequest request = Request();
  request.set_with_notes(true);
  v1::RenderIsosurfaceRequest moving = MovingRequest(request, {.jpeg_quality = 70});
  EXPECT_EQ(moving.output().image_format(), v1::OutputOptions::IMAGE_FORMAT_JPEG);
  EXPECT_EQ(moving.output().jpeg_quality(), 70);
  EXPECT_EQ(moving.samples(), 0);
  moving.clear_output();
  moving.set_samples(16);
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(moving, Request()));
}

TEST(InteractFrameTest, ASmallerFrameHasSmallerSidesAndEffects) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_ambient_occlusion();
  request.mutable_silhouette()->set_width_px(4);
  const v1::RenderIsosurfaceRequest moving = MovingRequest(request, {.scale = 0.5});
  EXPECT_EQ(moving.viewport().width_px(), 501);
  EXPECT_EQ(moving.viewport().height_px(), 250);
  EXPECT_EQ(moving.ambient_occlusion().radius_px(), 16) << "half of the default";
  EXPECT_EQ(moving.silhouette().width_px(), 2);
}

TEST(InteractFrameTest, SmallestSizesAreLegal) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_viewport()->set_width_px(1);
  request.mutable_viewport()->set_height_px(2);
  request.mutable_ambient_occlusion()->set_radius_px(5);
  request.mutable_silhouette();
  const v1::RenderIsosurfaceRequest moving = MovingRequest(request, {.scale = 0.25});
  EXPECT_EQ(moving.viewport().width_px(), 1);
  EXPECT_EQ(moving.viewport().height_px(), 1);
  EXPECT_EQ(moving.ambient_occlusion().radius_px(), 4);
  EXPECT_EQ(moving.silhouette().width_px(), 1);
}

TEST(InteractFrameTest, WrongSizesStayWrong) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_viewport()->set_width_px(0);
  request.mutable_viewport()->set_height_px(-7);
  const v1::RenderIsosurfaceRequest moving = MovingRequest(request, {.scale = 0.25});
  EXPECT_EQ(moving.viewport().width_px(), 0);
  EXPECT_EQ(moving.viewport().height_px(), -7);
}

TEST(InteractFrameTest, ARegionKeepsItsSize) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_region()->set_width_px(100);
  request.mutable_region()->set_height_px(100);
  EXPECT_EQ(MovingRequest(request, {.scale = 0.25}).viewport().width_px(), 1001);
}

TEST(InteractFrameTest, OutputsThatAreNoPictureAreNamed) {
  v1::ViewState state;
  *state.mutable_frame() = Request();
  EXPECT_THAT(CheckInteractiveOutput(state), IsOk());
  state.mutable_frame()->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_PNG);
  EXPECT_THAT(CheckInteractiveOutput(state), IsOk());
  state.mutable_frame()->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  EXPECT_THAT(CheckInteractiveOutput(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("image_format is 2")));
  state.mutable_frame()->clear_output();
  state.mutable_frame()->mutable_output()->set_position(true);
  EXPECT_THAT(CheckInteractiveOutput(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("plane")));
  state.mutable_frame()->clear_output();
  state.mutable_frame()->set_with_trace(true);
  EXPECT_THAT(CheckInteractiveOutput(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.with_trace")));
  state.mutable_frame()->clear_with_trace();
  state.mutable_frame()->set_allow_partial(true);
  EXPECT_THAT(CheckInteractiveOutput(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.allow_partial")));
}

}  // namespace
}  // namespace isoscope::server
