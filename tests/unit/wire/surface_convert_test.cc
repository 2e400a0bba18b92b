// Surfaces, caps, lights and colours by a quantity, from the request and back:
//
// - values arrive in their order, with their defaults;
// - hostile values, each named in the error (wrong_fields.h).

#include "wire/surface_convert.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/view/camera.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/wire/wrong_fields.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(SurfaceConvertTest, SurfacesArriveInTheirOrderWithTheirLook) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  request.add_surfaces()->set_isovalue(75);
  isoscope::v1::Surface* const second = request.add_surfaces();
  second->set_isovalue(-30);
  *second->mutable_color() = ToProto(image::Rgba8{9, 8, 7, 255});
  second->mutable_material()->set_ambient(0);
  second->mutable_material()->set_diffuse(0.5F);
  second->mutable_material()->set_specular(0.25F);
  second->mutable_material()->set_shininess(7);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  ASSERT_EQ(spec.surfaces.size(), 2U);
  EXPECT_EQ(spec.surfaces[0], (frame::Surface{.rule = {.isovalue = 75}, .appearance = {}}));
  EXPECT_EQ(spec.surfaces[1], (frame::Surface{.rule = {.isovalue = -30},
                                              .appearance = {.base_color = {9, 8, 7, 255},
                                                             .ambient = 0,
                                                             .diffuse = 0.5F,
                                                             .specular = 0.25F,
                                                             .shininess = 7}}));
}

TEST(SurfaceConvertTest, CapsArriveAndGoBack) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_y(-2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_FALSE(spec.caps.has_value());
  for (const frame::ClipCaps& caps :
       {frame::ClipCaps{}, frame::ClipCaps{.map = frame::ColorMap::kGrey},
        frame::ClipCaps{.map = frame::ColorMap::kViridis, .range = frame::ColorRange{-1, 2}}}) {
    *request.mutable_caps() = ToProto(caps);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
    EXPECT_EQ(spec.caps, caps);
  }
  // A box is a cut, too.
  request.clear_clip();
  *request.mutable_clip()->mutable_box()->mutable_min() = ToProto(math::Vec3d{1, 2, 3});
  *request.mutable_clip()->mutable_box()->mutable_max() = ToProto(math::Vec3d{1, 5, 6});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  EXPECT_TRUE(spec.caps.has_value());
}

TEST(SurfaceConvertTest, HostileCapsAreNamed) {
  const auto expect = [](const isoscope::v1::RenderIsosurfaceRequest& request, const char* what) {
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_caps();
  expect(request, "caps is set without clip: must be unset");
  request.mutable_clip();
  expect(request, "caps is set without clip");
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  ISOSCOPE_EXPECT_OK(FrameSpecFromProto(request));
  request.mutable_caps()->mutable_range()->set_max(1);
  expect(request, "caps.range is set without caps.color_map");
  for (const int map : {-1, 7, 1000}) {
    request.mutable_caps()->set_color_map(static_cast<isoscope::v1::ColorMap>(map));
    expect(request, "caps.color_map is ");
  }
  request.mutable_caps()->set_color_map(isoscope::v1::COLOR_MAP_GREY);
  ISOSCOPE_EXPECT_OK(FrameSpecFromProto(request));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double bad : {-kInfinity, kInfinity, std::nan("")}) {
    request.mutable_caps()->mutable_range()->set_min(bad);
    expect(request, "caps.range.min is ");
    request.mutable_caps()->mutable_range()->set_min(0);
    request.mutable_caps()->mutable_range()->set_max(bad);
    expect(request, "caps.range.max is ");
  }
  request.mutable_caps()->mutable_range()->set_max(0);
  expect(request, "caps.range.max is 0: must be greater than caps.range.min");
  request.mutable_caps()->mutable_range()->set_max(std::numeric_limits<double>::max());
  request.mutable_caps()->mutable_range()->set_min(-std::numeric_limits<double>::max());
  expect(request, "by a number that is finite");
}

TEST(SurfaceConvertTest, AlphaIsTheOpacityOfASurface) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_FALSE(frame::HasLayers(spec));
  EXPECT_EQ(spec.max_layers, 8);
  request.mutable_base_color()->set_green(1);
  request.mutable_base_color()->set_alpha(0.25F);
  request.set_max_layers(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  EXPECT_TRUE(frame::HasLayers(spec));
  EXPECT_EQ(spec.surfaces[0].opacity, 0.25F);
  EXPECT_EQ(spec.surfaces[0].appearance.base_color, (image::Rgba8{0, 255, 0, 255}));
  EXPECT_EQ(spec.max_layers, 3);
}

TEST(SurfaceConvertTest, LightsAndColorByArriveAndGoBack) {
  const frame::Light light{.direction = {1, -2, 3},
                           .space = frame::Light::Space::kWorld,
                           .intensity = 2.5F,
                           .color = {255, 0, 128, 255}};
  const frame::ColorBy by_z{.quantity = frame::ColorBy::Quantity::kPositionZ,
                            .map = frame::ColorMap::kCoolWarm,
                            .range = frame::ColorRange{-1, 4},
                            .opacity_at_min = 0,
                            .opacity_at_max = 0.75F};
  const frame::ColorBy by_normal{.quantity = frame::ColorBy::Quantity::kNormal};
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  *request.add_lights() = ToProto(light);
  request.add_lights()->mutable_direction()->set_z(1);
  *request.add_surfaces()->mutable_color_by() = ToProto(by_z);
  *request.add_surfaces()->mutable_color_by() = ToProto(by_normal);
  request.add_surfaces()->mutable_color_by()->set_quantity(
      isoscope::v1::ColorBy::QUANTITY_POSITION_X);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.lights, (std::vector<frame::Light>{light, frame::Light()}));
  EXPECT_EQ(spec.surfaces[0].color_by, by_z);
  EXPECT_EQ(spec.surfaces[1].color_by, by_normal);
  EXPECT_EQ(spec.surfaces[2].color_by, frame::ColorBy());
  EXPECT_TRUE(spec.surfaces[0].is_translucent()) << "by the opacities of its map alone";
  EXPECT_FALSE(spec.surfaces[2].is_translucent());
  EXPECT_FALSE(ToProto(frame::ColorBy()).has_opacity());
}

TEST(SurfaceConvertTest, AFieldIsNamedExactlyWhereItIsShown) {
  using ColorBy = isoscope::v1::ColorBy;
  const frame::ColorBy by_field{.quantity = frame::ColorBy::Quantity::kField,
                                .map = frame::ColorMap::kMagma,
                                .range = frame::ColorRange{-1, 4},
                                .opacity_at_max = 0.5F,
                                .field = "velocity",
                                .component = "x"};
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  ColorBy* const color_by = request.add_surfaces()->mutable_color_by();
  *color_by = ToProto(by_field);
  EXPECT_EQ(color_by->field(), "velocity");
  EXPECT_EQ(color_by->component(), "x");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.surfaces[0].color_by, by_field);
  EXPECT_TRUE(spec.surfaces[0].shows_field() && spec.surfaces[0].shows_values());
  EXPECT_EQ(frame::DrawnBy(spec, frame::BackEnd::kEgl), frame::BackEnd::kCpu);
  const auto expect = [&](const std::string& message) {
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  };
  color_by->set_quantity(ColorBy::QUANTITY_POSITION_X);
  expect(
      "surfaces[0].color_by.field is \"velocity\" beside surfaces[0].color_by.quantity 1, which "
      "shows no other field: must be unset");
  color_by->clear_field();
  expect("surfaces[0].color_by.component is \"x\" beside surfaces[0].color_by.quantity 1");
  color_by->set_quantity(ColorBy::QUANTITY_FIELD);
  expect("surfaces[0].color_by.field is not set: required with surfaces[0].color_by.quantity 6");
}

TEST(NanColorTest, IsOpaqueAndOneOfTheMapsOwnByDefault) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_FALSE(spec.nan_color.has_value());
  isoscope::v1::Color* const color = request.mutable_nan_color();
  color->set_red(1);
  color->set_green(0.5F);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("nan_color.alpha is 0")));
  color->set_alpha(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.nan_color, (image::Rgba8{255, 128, 0, 255}));
  color->set_blue(1.5F);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("nan_color.blue is 1.5")));
}

TEST(SurfaceConvertTest, EveryColorMapIsKnown) {
  for (int map = isoscope::v1::ColorMap_MIN + 1; map <= isoscope::v1::ColorMap_MAX; ++map) {
    isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
    request.set_isovalue(0);
    isoscope::v1::ColorBy* const color_by = request.add_surfaces()->mutable_color_by();
    color_by->set_quantity(isoscope::v1::ColorBy::QUANTITY_POSITION_X);
    color_by->set_color_map(static_cast<isoscope::v1::ColorMap>(map));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
    EXPECT_EQ(ToProto(*spec.surfaces[0].color_by).color_map(), color_by->color_map());
  }
}

TEST(SurfaceConvertTest, HostileLightsAndColorByAreNamed) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  using Request = isoscope::v1::RenderIsosurfaceRequest;
  Request good = MakeRequest();
  good.set_isovalue(0);
  isoscope::v1::ColorBy* const color_by = good.add_surfaces()->mutable_color_by();
  color_by->set_quantity(isoscope::v1::ColorBy::QUANTITY_POSITION_Y);
  color_by->mutable_range()->set_max(1);
  good.add_lights()->mutable_direction()->set_z(1);
  good.mutable_lights(0)->mutable_color()->set_alpha(1);
  ExpectNamed(
      good, {{"lights[0].direction.z", {kNan, 0, kInfinity, 1e300, 1e-300}, "lights[0].direction"},
             {"lights[0].intensity", {kNan, -0.1, 10.1, kInfinity}},
             {"lights[0].space", {-1, 3, 1e9}},
             {"lights[0].color.green", {kNan, -0.01, 1.01}},
             {"lights[0].color.alpha", {kNan, 0, 0.5}},
             {"surfaces[0].color_by.quantity", {0, -1, 7}},
             {"surfaces[0].color_by.color_map", {-1, 7, 1e9}},
             {"surfaces[0].color_by.range.min", {kNan, kInfinity, 1, 2}},
             {"surfaces[0].color_by.range.max", {kNan, -kInfinity, 0, -1}},
             {"surfaces[0].color_by.opacity.at_min", {kNan, -0.01, 1.01, kInfinity}},
             {"surfaces[0].color_by.opacity.at_max", {kNan, -1, 2, -kInfinity}},
             {"surfaces[0].color_by.quantity",
              {isoscope::v1::ColorBy::QUANTITY_NORMAL},
              "surfaces[0].color_by.range is set beside"}});
  color_by->clear_range();
  color_by->set_quantity(isoscope::v1::ColorBy::QUANTITY_NORMAL);
  const std::string beside = " is set beside surfaces[0].color_by.quantity 4";
  ExpectNamed(
      good, {{"surfaces[0].color_by.opacity.at_max", {0}, "surfaces[0].color_by.opacity" + beside},
             {"surfaces[0].color_by.color_map",
              {isoscope::v1::COLOR_MAP_GREY},
              "surfaces[0].color_by.color_map" + beside}});
  while (good.lights_size() < 5) {
    *good.add_lights() = good.lights(0);
  }
  EXPECT_THAT(FrameSpecFromProto(good),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("lights has 5 elements: must have at most 4")));
}

TEST(LabelsTest, TheyStandInPlaceOfTheIsovalue) {
  isoscope::v1::RenderIsosurfaceRequest request;
  isoscope::v1::Surface* const surface = request.add_surfaces();
  for (const double label : {7.0, 3.0, 7.0, -0.0}) {
    surface->add_labels(label);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto surfaces, SurfacesFromProto(request));
  EXPECT_EQ(surfaces[0].rule, volume::InsideRule::OfLabels({0, 3, 7}));
}

TEST(LabelsTest, SmoothOnesArriveAndComeBack) {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.add_surfaces()->add_labels(3);
  request.mutable_surfaces(0)->set_smooth_labels(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto surfaces, SurfacesFromProto(request));
  EXPECT_EQ(surfaces[0].rule, volume::InsideRule::OfLabels({3}, /*smooths=*/true));
  EXPECT_TRUE(ToProto(surfaces[0]).smooth_labels());
  request.mutable_surfaces(0)->clear_labels();
  EXPECT_THAT(SurfacesFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("surfaces[0].smooth_labels is set without surfaces[0].labels")));
}

TEST(LabelsTest, WrongOnesAreRefusedByName) {
  using isoscope::v1::Surface;
  const auto expect = [](const std::string& what, const auto& change) {
    isoscope::v1::RenderIsosurfaceRequest request;
    request.add_surfaces();
    Surface* const surface = request.add_surfaces();
    surface->add_labels(1);
    change(surface);
    EXPECT_THAT(SurfacesFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect("surfaces[1].labels[1] is nan: must be finite",
         [](Surface* s) { s->add_labels(std::numeric_limits<double>::quiet_NaN()); });
  expect("surfaces[1].labels[1] is inf",
         [](Surface* s) { s->add_labels(std::numeric_limits<double>::infinity()); });
  expect("surfaces[1].isovalue is 60 beside surfaces[1].labels: must be unset",
         [](Surface* s) { s->set_isovalue(60); });
  expect("surfaces[1].labels has 257 different values: must have 1 to 256", [](Surface* s) {
    for (int i = 0; i < 300; ++i) {
      s->add_labels(i % 257);
    }
  });
  expect("surfaces[1].color_by.quantity is 5 (gradient magnitude) beside surfaces[1].labels",
         [](Surface* s) {
           s->mutable_color_by()->set_quantity(isoscope::v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
         });
}

}  // namespace
}  // namespace isoscope::wire
