#include "clients/cpp/request/render_request.h"

#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"
#include "wire/frame_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

view::Camera SampleCamera() {
  return {.eye = {0, 0, 10}, .target = {0, 0, 0}, .fov_y_radians = 0.5};
}

TEST(RenderRequestTest, DefaultsAreThoseOfTheContract) {
  const v1::RenderIsosurfaceRequest request =
      MakeRequest({.isovalue = -1.5}, "head", SampleCamera());
  EXPECT_EQ(request.dataset(), "head");
  EXPECT_EQ(request.isovalue(), -1.5);
  EXPECT_EQ(request.viewport().width_px(), 1024);
  EXPECT_EQ(request.viewport().height_px(), 1024);
  EXPECT_EQ(request.culling(), v1::CULLING_DEPTH);
  EXPECT_EQ(request.camera().eye().z(), 10);
  EXPECT_FALSE(request.has_base_color());
  EXPECT_FALSE(request.has_background_color());
}

TEST(RenderRequestTest, EveryFlagReachesItsField) {
  const v1::RenderIsosurfaceRequest request =
      MakeRequest({.isovalue = 1,
                   .width = 640,
                   .height = 480,
                   .culling = frame::Culling::kMask,
                   .base_color = frame::Color{.red = 0.25F, .green = 0.5F, .blue = 1},
                   .background_color = frame::Color{.red = 1, .alpha = 0.5F}},
                  "", SampleCamera());
  EXPECT_EQ(request.viewport().width_px(), 640);
  EXPECT_EQ(request.viewport().height_px(), 480);
  EXPECT_EQ(request.culling(), v1::CULLING_MASK);
  EXPECT_EQ(request.base_color().red(), 0.25F);
  EXPECT_EQ(request.base_color().green(), 0.5F);
  EXPECT_EQ(request.base_color().blue(), 1.0F);
  EXPECT_EQ(request.base_color().alpha(), 1.0F);
  EXPECT_EQ(request.background_color().red(), 1.0F);
  EXPECT_EQ(request.background_color().alpha(), 0.5F);
}

TEST(RenderRequestTest, ARegionIsPartOfTheRequestAndMustLieInTheViewport) {
  RequestFlags flags{.isovalue = 1, .width = 40000, .height = 300};
  flags.region = view::Region{39000, 10, 1000, 200};
  ISOSCOPE_EXPECT_OK(CheckUsage(flags));
  EXPECT_EQ(flags.image_size(), (view::Viewport{1000, 200}));
  const v1::RenderIsosurfaceRequest request = MakeRequest(flags, "", SampleCamera());
  EXPECT_EQ(request.region().x(), 39000);
  EXPECT_EQ(request.region().y(), 10);
  EXPECT_EQ(request.region().width_px(), 1000);
  EXPECT_EQ(request.region().height_px(), 200);
  flags.region->height_px = 291;
  const absl::Status status = CheckUsage(flags);
  EXPECT_TRUE(cli::IsUsageError(status));
  EXPECT_NE(status.message().find("--region"), absl::string_view::npos);
}

TEST(RenderRequestTest, IsovalueIsRequired) {
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(RequestFlags{})));
  ISOSCOPE_EXPECT_OK(CheckUsage(RequestFlags{.isovalue = 0}));
}

TEST(RenderRequestTest, SurfacesAndClippingComeFromTheirFlags) {
  RequestFlags flags;
  flags.surfaces = {{.isovalue = 75, .color = {}},
                    {.isovalue = 30, .color = frame::Color{1, 0, 0, 1}}};
  flags.clip.planes = {{.normal = {1, 0, 0}, .offset = 12}};
  flags.clip.box = math::Box3d{{0, 1, 2}, {3, 4, 5}};
  flags.caps = frame::ClipCaps{.map = frame::ColorMap::kGrey};
  ISOSCOPE_EXPECT_OK(CheckUsage(flags));
  EXPECT_EQ(flags.isovalues(), (std::vector<double>{75, 30}));
  const isoscope::v1::RenderIsosurfaceRequest request = MakeRequest(flags, "head", SampleCamera());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, wire::FrameSpecFromProto(request));
  ASSERT_EQ(spec.surfaces.size(), 2U);
  EXPECT_EQ(spec.surfaces[1].rule.isovalue, 30);
  EXPECT_EQ(spec.surfaces[1].appearance.base_color, (image::Rgba8{255, 0, 0, 255}));
  EXPECT_EQ(spec.clip, (view::ClipRegion{.half_spaces = {{{1, 0, 0}, 12}},
                                         .box = math::Box3d{{0, 1, 2}, {3, 4, 5}}}));
  EXPECT_EQ(spec.caps, flags.caps);
  flags.clip = {};
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags))) << "there is no cut to fill";
}

TEST(RenderRequestTest, SurfacesExcludeTheFlagsOfASingleOne) {
  EXPECT_TRUE(cli::IsUsageError(
      CheckUsage(RequestFlags{.isovalue = 3, .surfaces = {{.isovalue = 1, .color = {}}}})));
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(
      RequestFlags{.base_color = frame::Color(), .surfaces = {{.isovalue = 1, .color = {}}}})));
  RequestFlags many;
  many.surfaces.resize(129);
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(many)));
  many.surfaces.resize(128);
  ISOSCOPE_EXPECT_OK(CheckUsage(many));
  many.clip.planes.resize(7);
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(many)));
}

TEST(PromoteIsovalueTest, TheOnlySurfaceKeepsItsColorAndSurfacesStayAsTheyAre) {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(7);
  request.mutable_base_color()->set_red(1);
  PromoteIsovalue(&request);
  ASSERT_EQ(request.surfaces_size(), 1);
  EXPECT_EQ(request.surfaces(0).isovalue(), 7);
  EXPECT_EQ(request.surfaces(0).color().red(), 1);
  EXPECT_EQ(request.isovalue(), 0);
  EXPECT_FALSE(request.has_base_color());
  PromoteIsovalue(&request);
  EXPECT_EQ(request.surfaces_size(), 1);
}

}  // namespace
}  // namespace isoscope::client
