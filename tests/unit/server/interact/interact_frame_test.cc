#include "server/interact/interact_frame.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

v1::ViewState State() {
  v1::ViewState state;
  v1::RenderIsosurfaceRequest& request = *state.mutable_frame();
  request.set_dataset("head");
  request.set_isovalue(60);
  request.mutable_viewport()->set_width_px(1001);
  request.mutable_viewport()->set_height_px(500);
  request.set_samples(16);
  return state;
}

TEST(InteractFrameTest, AMovingFrameIsAJpegOfOneSampleAndOtherwiseTheSame) {
  v1::ViewState state = State();
  state.mutable_frame()->set_with_notes(true);
  state.mutable_frame()->set_with_unresolved_count(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame exact, ExactFrameOf(state));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving,
                                MovingFrameOf(state, {.jpeg_quality = 70}));
  EXPECT_EQ(moving.dataset, "head");
  EXPECT_TRUE(exact.with_notes);
  EXPECT_TRUE(exact.with_unresolved_count);
  EXPECT_FALSE(moving.with_notes);
  EXPECT_FALSE(moving.with_unresolved_count);
  frame::FrameSpec expected = exact.spec;
  expected.output = {.image_format = frame::ImageFormat::kJpeg, .jpeg_quality = 70};
  expected.effects.samples_per_side = 1;
  EXPECT_EQ(moving.spec, expected);
}

TEST(InteractFrameTest, ASmallerFrameHasSmallerSidesAndEffects) {
  v1::ViewState state = State();
  state.mutable_frame()->mutable_ambient_occlusion();
  state.mutable_frame()->mutable_silhouette()->set_width_px(4);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving,
                                MovingFrameOf(state, {.scale = 0.5}));
  EXPECT_EQ(moving.spec.viewport, (view::Viewport{501, 250}));
  EXPECT_EQ(moving.spec.effects.ambient_occlusion->radius_px, 16) << "half of the default";
  EXPECT_EQ(moving.spec.effects.silhouette->width_px, 2);
}

// Symptom: each moving frame of a large screen was drawn in bands, several times as slow.
TEST(InteractFrameTest, AMovingFrameIsRatherSmallerThanDrawnInBands) {
  v1::ViewState state = State();
  state.mutable_frame()->mutable_silhouette()->set_width_px(8);
  state.mutable_frame()->set_camera_fit(v1::CAMERA_FIT_CELLS);
  const auto fits = [](const frame::FrameSpec& spec) {
    return spec.viewport.width_px * spec.viewport.height_px <= 130'000;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving, MovingFrameOf(state, {}, fits));
  EXPECT_EQ(moving.spec.viewport, (view::Viewport{422, 211})) << "0.75 times 0.75 is too large";
  EXPECT_LT(moving.spec.effects.silhouette->width_px, 8);
  EXPECT_EQ(moving.fit_viewport, (view::Viewport{1001, 500}));
  // What fits keeps the size that the connection has.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame small,
                                MovingFrameOf(state, {.scale = 0.5}, fits));
  EXPECT_EQ(small.spec.viewport, (view::Viewport{501, 250}));
  // If nothing fits, the frame is drawn in bands, and none is lost.
  const auto none = [](const frame::FrameSpec&) { return false; };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame least, MovingFrameOf(state, {}, none));
  EXPECT_LE(least.spec.viewport.width_px, 1001 / 32);
  EXPECT_GE(least.spec.viewport.width_px, 1001 / 64);
  state.mutable_frame()->mutable_region()->set_width_px(100);
  state.mutable_frame()->mutable_region()->set_height_px(100);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame region, MovingFrameOf(state, {}, none));
  EXPECT_EQ(region.spec.viewport.width_px, 1001);
}

// Else the view would jump by part of a pixel when it comes to rest.
TEST(InteractFrameTest, ASmallerFrameFitsTheCameraOfTheWhole) {
  v1::ViewState state = State();
  state.mutable_frame()->set_camera_fit(v1::CAMERA_FIT_CELLS);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving,
                                MovingFrameOf(state, {.scale = 0.25}));
  EXPECT_EQ(moving.fit, v1::CAMERA_FIT_CELLS);
  EXPECT_EQ(moving.fit_viewport, (view::Viewport{1001, 500}));
}

TEST(InteractFrameTest, TheCoarseFrameAtRestHasItsOwnQualityWhereTheNetworkIsFast) {
  const MovingQuality fast = RestQualityOf({.scale = 0.25});
  EXPECT_EQ(fast.jpeg_quality, kRestJpegQuality);
  EXPECT_GT(kRestJpegQuality, MovingQuality().jpeg_quality) << "that of moving views";
  EXPECT_EQ(fast.scale, 1);
  const MovingQuality slow = RestQualityOf({.jpeg_quality = 60, .scale = 0.5});
  EXPECT_EQ(slow.jpeg_quality, 60);
  EXPECT_EQ(slow.scale, 1);
}

// A frame whose camera the server chooses, and what its client asks for once it has that camera.
struct ToldCamera {
  v1::RenderIsosurfaceRequest frame;
  v1::Camera told;
  v1::RenderIsosurfaceRequest next;

  ToldCamera() : frame(State().frame()), next(frame) {
    frame.set_camera_fit(v1::CAMERA_FIT_CELLS);
    told.mutable_eye()->set_x(-0.0);
    told.mutable_eye()->set_z(7);
    told.mutable_target();
    told.mutable_up()->set_y(1);
    told.mutable_perspective()->set_fov_y_degrees(30);
    *next.mutable_camera() = told;
  }
  [[nodiscard]] bool IsSame() const { return HasToldCamera(frame, told, next); }
};

// Symptom: "Draw exact" of the first picture sent its coarse frame again.
TEST(InteractFrameTest, AFrameWithTheCameraThatWasToldIsTheSamePicture) {
  ToldCamera frames;
  EXPECT_TRUE(frames.IsSame());
  frames.next.set_camera_fit(v1::CAMERA_FIT_VOLUME);
  EXPECT_TRUE(frames.IsSame());
  frames.next.mutable_camera()->mutable_eye()->set_x(0);
  EXPECT_TRUE(frames.IsSame()) << "JavaScript writes -0 as 0";
  frames.next.mutable_camera()->clear_up();
  EXPECT_TRUE(frames.IsSame()) << "the default";
}

TEST(InteractFrameTest, AFrameThatDiffersFromTheToldOneIsAnotherPicture) {
  ToldCamera of_other_camera;
  of_other_camera.next.mutable_camera()->mutable_eye()->set_z(7.000000000000001);
  EXPECT_FALSE(of_other_camera.IsSame());
  ToldCamera without_camera;
  without_camera.next.clear_camera();
  EXPECT_FALSE(without_camera.IsSame());
  ToldCamera of_wrong_camera;
  of_wrong_camera.next.mutable_camera()->mutable_perspective()->set_fov_y_degrees(-30);
  EXPECT_FALSE(of_wrong_camera.IsSame());
  ToldCamera fitted_again;
  fitted_again.next.set_camera_fit(v1::CAMERA_FIT_CELLS);
  EXPECT_FALSE(fitted_again.IsSame());
  ToldCamera of_other_surface;
  of_other_surface.next.set_isovalue(61);
  EXPECT_FALSE(of_other_surface.IsSame());
  ToldCamera with_effect;
  with_effect.next.mutable_ambient_occlusion();
  EXPECT_FALSE(with_effect.IsSame()) << "a message without fields says something";
}

TEST(InteractFrameTest, SmallestSizesAreLegal) {
  v1::ViewState state = State();
  state.mutable_frame()->mutable_viewport()->set_width_px(1);
  state.mutable_frame()->mutable_viewport()->set_height_px(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving,
                                MovingFrameOf(state, {.scale = 0.25}));
  EXPECT_EQ(moving.spec.viewport, (view::Viewport{1, 1}));
}

TEST(InteractFrameTest, AWrongStateIsRefusedInMotionToo) {
  v1::ViewState state = State();
  state.mutable_frame()->mutable_viewport()->set_height_px(-7);
  EXPECT_THAT(MovingFrameOf(state, {.scale = 0.25}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("viewport.height_px is -7")));
  state = State();
  state.mutable_frame()->mutable_background_color()->set_alpha(0.5F);
  EXPECT_THAT(ExactFrameOf(state), IsOk());
  EXPECT_THAT(MovingFrameOf(state, {}),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("background_color.alpha is 0.5: must be 1")));
}

TEST(InteractFrameTest, ARegionKeepsItsSize) {
  v1::ViewState state = State();
  state.mutable_frame()->mutable_region()->set_width_px(100);
  state.mutable_frame()->mutable_region()->set_height_px(100);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const wire::AskedFrame moving,
                                MovingFrameOf(state, {.scale = 0.25}));
  EXPECT_EQ(moving.spec.viewport.width_px, 1001);
}

TEST(InteractFrameTest, OutputsThatAreNoPictureAreNamed) {
  v1::ViewState state = State();
  EXPECT_THAT(ExactFrameOf(state), IsOk());
  state.mutable_frame()->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_PNG);
  EXPECT_THAT(ExactFrameOf(state), IsOk());
  state.mutable_frame()->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  EXPECT_THAT(ExactFrameOf(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("image_format is 2")));
  state.mutable_frame()->clear_output();
  state.mutable_frame()->mutable_output()->set_position(true);
  EXPECT_THAT(ExactFrameOf(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("plane")));
  state.mutable_frame()->clear_output();
  state.mutable_frame()->set_with_trace(true);
  EXPECT_THAT(ExactFrameOf(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.with_trace")));
  state.mutable_frame()->clear_with_trace();
  state.mutable_frame()->set_allow_partial(true);
  EXPECT_THAT(ExactFrameOf(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.allow_partial")));
}

// Symptom: the colours would flicker while the view turns.
TEST(InteractFrameTest, ARangeOfWhatIsVisibleIsRefusedAndOneOfTheStepIsNot) {
  v1::ViewState state = State();
  state.mutable_frame()->clear_isovalue();
  v1::ColorBy& color_by = *state.mutable_frame()->add_surfaces()->mutable_color_by();
  color_by.set_quantity(v1::ColorBy::QUANTITY_POSITION_X);
  color_by.mutable_range()->set_source(v1::ColorRange::SOURCE_STEP);
  EXPECT_THAT(ExactFrameOf(state), IsOk());
  color_by.mutable_range()->set_source(v1::ColorRange::SOURCE_VISIBLE);
  EXPECT_THAT(ExactFrameOf(state),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("source 2 (visible)")));
  EXPECT_THAT(MovingFrameOf(state, {}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("source 2 (visible)")));
}

}  // namespace
}  // namespace isoscope::server
