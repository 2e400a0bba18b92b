// Conversion of a request to a FrameSpec, field by field:
//
// - defaults of unset fields, and the arrival of every field that is set;
// - wrong values: the error names the field, its value and the allowed values (wrong_fields.h);
// - the resolved camera, which must have the same bits at coordinator and agents;
// - the message that agents get, value by value;
// - picture revisions.

#include "wire/frame_convert.h"

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/view/camera.h"
#include "core/view/camera_fit.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/wire/wrong_fields.h"
#include "wire/first_look.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(FrameSpecFromProtoTest, UnsetMembersTakeTheirDefaults) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(MakeRequest()));
  frame::FrameSpec expected;
  expected.surfaces = {{.rule = {.isovalue = 60}, .appearance = {}}};
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
  request.mutable_base_color()->set_red(0.5F);
  expect(request, "base_color.alpha is 0");
  for (const int count : {-1, 17}) {
    request = MakeRequest();
    request.set_max_layers(count);
    expect(request, "max_layers is ");
  }
  request = MakeRequest();
  request.mutable_camera()->mutable_eye()->set_x(1);
  expect(request, "camera");
  request = MakeRequest();
  request.add_surfaces()->set_isovalue(3);
  expect(request, "isovalue is set beside surfaces");
  request.set_isovalue(0);
  *request.mutable_base_color() = ToProto(image::Rgba8{1, 2, 3, 255});
  expect(request, "base_color is set beside surfaces");
  request = MakeRequest();
  request.set_isovalue(0);
  for (int i = 0; i < 129; ++i) {
    request.add_surfaces();
  }
  expect(request, "surfaces has 129 elements: must have at most 128");
  request = MakeRequest();
  request.set_culling(static_cast<isoscope::v1::Culling>(12));
  expect(request, "culling");
  request = MakeRequest();
  request.GetReflection()->MutableUnknownFields(&request)->AddVarint(90, 1);
  expect(request, "number 90");
}

TEST(FrameSpecFromProtoTest, TheClipRegionArrives) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  isoscope::v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_y(-2);
  half_space->set_offset(3.5);
  *request.mutable_clip()->mutable_box()->mutable_min() = ToProto(math::Vec3d{1, 2, 3});
  *request.mutable_clip()->mutable_box()->mutable_max() = ToProto(math::Vec3d{1, 5, 6});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.clip, (view::ClipRegion{.half_spaces = {{{0, -2, 0}, 3.5}},
                                         .box = math::Box3d{{1, 2, 3}, {1, 5, 6}}}));
}

TEST(FrameSpecFromProtoTest, HostileSurfacesAndRegionsAreNamed) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  using Request = isoscope::v1::RenderIsosurfaceRequest;
  Request good = MakeRequest();
  good.set_isovalue(0);
  good.add_surfaces();
  *good.add_surfaces()->mutable_color() = ToProto(image::Rgba8{1, 2, 3, 255});
  good.mutable_clip()->add_half_spaces()->mutable_normal()->set_z(1);
  *good.mutable_clip()->mutable_box()->mutable_min() = ToProto(math::Vec3d{-1, -1, -1});
  *good.mutable_clip()->mutable_box()->mutable_max() = ToProto(math::Vec3d{1, 1, 1});
  ExpectNamed(
      good,
      {{"surfaces[1].isovalue", {kNan, kInfinity, -kInfinity}},
       {"surfaces[1].color.red", {kNan, -0.01, 1.01, kInfinity}},
       {"surfaces[1].color.alpha", {kNan, 0, -0.5, 2}},
       {"surfaces[1].material.ambient", {kNan, -1, 1.5, kInfinity}},
       {"surfaces[1].material.diffuse", {kNan, -1, 1.5, kInfinity}},
       {"surfaces[1].material.specular", {kNan, -1, 1.5, kInfinity}},
       {"surfaces[1].material.shininess", {kNan, 0, 0.5, 1001, kInfinity}},
       {"clip.half_spaces[0].normal.z", {kNan, 0, kInfinity, 1e300}, "clip.half_spaces[0].normal"},
       {"clip.half_spaces[0].offset", {kNan, kInfinity}},
       {"clip.box.min.x", {kNan, kInfinity}, "clip.box.min"},
       {"clip.box.max.x", {kNan, kInfinity, -5}}});
  Request request = MakeRequest();
  request.mutable_clip()->mutable_box();
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("clip.box.min is not set")));
  for (int i = 0; i < 7; ++i) {
    request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  }
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("clip.half_spaces has 7 elements: must have at most 6")));
}

TEST(ExportSpecFromProtoTest, SurfacesAndRegionArrive) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(60);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ExportSpec one, ExportSpecFromProto(request));
  EXPECT_THAT(one.rules, ElementsAre(volume::InsideRule::OfIsovalue(60)));
  EXPECT_EQ(one.clip, view::ClipRegion());
  request.set_isovalue(0);
  request.add_surfaces()->set_isovalue(75);
  request.add_surfaces()->set_isovalue(-3);
  isoscope::v1::Surface* const labels = request.add_surfaces();
  labels->add_labels(7);
  labels->add_labels(3);
  isoscope::v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_y(-2);
  half_space->set_offset(3.5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ExportSpec several, ExportSpecFromProto(request));
  EXPECT_THAT(several.rules,
              ElementsAre(volume::InsideRule::OfIsovalue(75), volume::InsideRule::OfIsovalue(-3),
                          volume::InsideRule::OfLabels({3, 7})));
  EXPECT_EQ(several.clip,
            (view::ClipRegion{.half_spaces = {{{0, -2, 0}, 3.5}}, .box = std::nullopt}));
}

TEST(ExportSpecFromProtoTest, ASmoothMeshCantBeCut) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.add_surfaces()->add_labels(3);
  request.add_surfaces()->add_labels(7);
  request.mutable_surfaces(1)->set_smooth_labels(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ExportSpec whole, ExportSpecFromProto(request));
  EXPECT_THAT(whole.rules, ElementsAre(volume::InsideRule::OfLabels({3}),
                                       volume::InsideRule::OfLabels({7}, /*smooths=*/true)));
  request.mutable_clip();
  EXPECT_THAT(ExportSpecFromProto(request), IsOk()) << "it cuts nothing";
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  EXPECT_THAT(ExportSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("surfaces[1].smooth_labels is set beside clip")));
}

TEST(ExportSpecFromProtoTest, HostileValuesAreNamed) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  using Request = isoscope::v1::ExportIsosurfaceRequest;
  const std::vector<std::pair<const char*, std::function<void(Request*)>>> cases{
      {"isovalue is nan", [&](Request* r) { r->set_isovalue(kNan); }},
      {"isovalue is set beside surfaces",
       [](Request* r) {
         r->set_isovalue(3);
         r->add_surfaces();
       }},
      {"surfaces has 65537 elements",
       [](Request* r) {
         for (int i = 0; i < 65537; ++i) {
           r->add_surfaces();
         }
       }},
      {"surfaces[0].isovalue is nan", [&](Request* r) { r->add_surfaces()->set_isovalue(kNan); }},
      {"surfaces[0].material.shininess",
       [](Request* r) { r->add_surfaces()->mutable_material()->set_shininess(-1); }},
      {"clip.half_spaces has 7 elements",
       [](Request* r) {
         for (int i = 0; i < 7; ++i) {
           r->mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
         }
       }},
      {"clip.half_spaces[0].normal", [](Request* r) { r->mutable_clip()->add_half_spaces(); }},
      {"clip.half_spaces[0].offset is inf",
       [](Request* r) {
         r->mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
         r->mutable_clip()->mutable_half_spaces(0)->set_offset(
             std::numeric_limits<double>::infinity());
       }},
      {"clip.box.min is not set", [](Request* r) { r->mutable_clip()->mutable_box(); }},
      {"clip.box.max.y is -1",
       [](Request* r) {
         r->mutable_clip()->mutable_box()->mutable_min();
         r->mutable_clip()->mutable_box()->mutable_max()->set_y(-1);
       }},
      {"number 90",
       [](Request* r) { r->GetReflection()->MutableUnknownFields(r)->AddVarint(90, 1); }},
  };
  for (const auto& [message, spoil] : cases) {
    Request request;
    spoil(&request);
    EXPECT_THAT(ExportSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  }
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

TEST(FrameSpecFromProtoTest, SamplesAreASquareOfAtMost16) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  for (const auto& [samples, side] : {std::pair(0, 1), {1, 1}, {4, 2}, {9, 3}, {16, 4}}) {
    request.set_samples(samples);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
    EXPECT_EQ(spec.effects.samples_per_side, side);
  }
  for (const int samples : {-1, 2, 3, 5, 8, 10, 15, 17, 25, 1 << 30, INT32_MIN}) {
    request.set_samples(samples);
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr(absl::StrCat("samples is ", samples, ": must be 1, 4, 9"))));
  }
}

TEST(FrameSpecFromProtoTest, EffectsArriveWithTheirDefaults) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.effects, frame::PictureEffects());
  request.mutable_ambient_occlusion();
  request.mutable_silhouette();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.effects.ambient_occlusion, frame::AmbientOcclusion());
  EXPECT_EQ(spec.effects.silhouette, frame::Silhouette());
  request.mutable_ambient_occlusion()->set_radius_px(56);
  request.mutable_ambient_occlusion()->set_strength(0);
  request.mutable_silhouette()->set_width_px(16);
  *request.mutable_silhouette()->mutable_color() = ToProto(image::Rgba8{9, 8, 7, 255});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.effects.ambient_occlusion,
            (frame::AmbientOcclusion{.radius_px = 56, .strength = 0}));
  EXPECT_EQ(spec.effects.silhouette, (frame::Silhouette{.width_px = 16, .color = {9, 8, 7, 255}}));
}

TEST(FrameSpecFromProtoTest, HostileEffectsAreNamed) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  isoscope::v1::RenderIsosurfaceRequest good = MakeRequest();
  good.mutable_silhouette()->mutable_color()->set_alpha(1);
  ExpectNamed(good, {{"ambient_occlusion.radius_px", {-1, 1, 3, 57, 2147483647, -2147483648.0}},
                     {"ambient_occlusion.strength", {kNan, -0.001, 1.001, kInfinity, -kInfinity}},
                     {"silhouette.width_px", {-1, 17, 2147483647, -2147483648.0}},
                     {"silhouette.color.green", {kNan, -1, 2, kInfinity}},
                     {"silhouette.color.alpha", {kNan, 0, 0.5, 2}}});
}

TEST(FrameSpecFromProtoTest, SamplesOfALargeViewportAreRefusedWithBothNumbers) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_viewport()->set_width_px(8192);
  request.set_samples(4);
  EXPECT_THAT(FrameSpecFromProto(request), IsOk());
  request.set_samples(9);
  EXPECT_THAT(FrameSpecFromProto(request), IsOk()) << "drawn in bands";
  request.set_culling(isoscope::v1::CULLING_MASK);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("samples is 9"), HasSubstr("viewport of 8192 x"),
                             HasSubstr("CULLING_MASK"), HasSubstr("16384"))));
  // With a region it is allowed, up to the largest viewport.
  *request.mutable_region() = ToProto(view::Region{0, 0, 1000, 20});
  EXPECT_THAT(FrameSpecFromProto(request), IsOk());
  request.mutable_viewport()->set_width_px(32768);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("samples is 9"), HasSubstr("viewport of 32768 x"),
                             HasSubstr("65536"))));
}

TEST(ResolveCameraTest, AgentsReadTheSameBitsFromTheMessage) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(MakeRequest()));
  ISOSCOPE_ASSERT_OK(ResolveCamera({{0, 0, 0}, {3, 1, 2}}, &spec));
  EXPECT_TRUE(spec.camera.has_value());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec agent_spec,
                                FrameSpecFromProto(ToProto(spec)));
  EXPECT_EQ(agent_spec, spec);
}

TEST(ResolveCameraTest, ACameraThatIsSetStays) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  *request.mutable_camera() = ToProto(view::MakeDefaultCamera({{0, 0, 0}, {4, 5, 6}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  const frame::FrameSpec before = spec;
  ISOSCOPE_ASSERT_OK(ResolveCamera({{0, 0, 0}, {300, 1, 2}}, &spec));
  EXPECT_EQ(spec, before);
}

TEST(ResolveCellsCameraTest, TheCameraIsTheFirstLookOrTheGivenOneAndAgentsReadItsBits) {
  const math::Box3d bounds{.min = {0, 0, 0}, .max = {30, 10, 20}};
  const math::Box3d cells{.min = {1, 2, 3}, .max = {11, 4, 6}};
  const view::Viewport viewport{640, 480};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec plain, FrameSpecFromProto(MakeRequest()));
  for (const std::optional<math::Box3d>& box :
       {std::optional(cells), std::optional<math::Box3d>()}) {
    frame::FrameSpec spec = plain;
    ISOSCOPE_ASSERT_OK(ResolveCellsCamera(bounds, box, std::nullopt, viewport, &spec));
    const view::Camera expected = view::FitToBox(FirstLookCamera(bounds, std::nullopt), viewport,
                                                 bounds, box.value_or(bounds));
    EXPECT_EQ(ToProto(*spec.camera).SerializeAsString(), ToProto(expected).SerializeAsString());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec agent_spec,
                                  FrameSpecFromProto(ToProto(spec)));
    EXPECT_EQ(agent_spec.camera, spec.camera);
  }
  frame::FrameSpec given = plain;
  given.camera = view::MakeDefaultCamera(bounds);
  const view::Camera front = *given.camera;
  ISOSCOPE_ASSERT_OK(ResolveCellsCamera(bounds, cells, volume::PatientFrame(), viewport, &given));
  EXPECT_EQ(given.camera->up, front.up) << "a given direction stays";
  EXPECT_NE(given.camera->eye, front.eye);
}

TEST(AskedFrameTest, AFitIsNeverUnspecifiedAndRemembersTheWholeViewport) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const AskedFrame plain, AskedFrameFromProto(request));
  EXPECT_EQ(plain.fit, isoscope::v1::CAMERA_FIT_VOLUME);
  request.set_camera_fit(isoscope::v1::CAMERA_FIT_CELLS);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const AskedFrame cells, AskedFrameFromProto(request));
  EXPECT_EQ(cells.fit, isoscope::v1::CAMERA_FIT_CELLS);
  EXPECT_EQ(cells.fit_viewport, cells.spec.viewport);
}

// Changes one of the values that a frame is made of: the one of a number, in the order of the walk.
// It names the members of each struct: with a new member this does not compile. Then the walk must
// visit it, too.
class OneChange {
 public:
  explicit OneChange(int number) : number_(number) {}

  // The number of values visited.
  [[nodiscard]] int count() const { return count_; }

  void Visit(frame::FrameSpec& spec) {
    auto& [surfaces, camera, viewport, region, culling, background_color, clip, caps, max_layers,
           lights, ray_seed, nan_color, output, effects, sends_normals, sends_map_steps, level] =
        spec;
    // Agents never get nan_color, output and effects.
    VisitAll(surfaces, camera, viewport, region, culling, background_color, background_color.a,
             clip, caps, max_layers, lights, ray_seed, sends_normals, sends_map_steps, level);
  }

 private:
  template <typename... Members>
  void VisitAll(Members&... members) {
    (Visit(members), ...);
  }
  bool IsNext() { return count_++ == number_; }

  void Visit(bool& value) { value ^= IsNext(); }
  void Visit(double& value) { value += IsNext() ? 0.25 : 0; }
  void Visit(float& value) { value *= IsNext() ? 0.5F : 1; }
  void Visit(std::string& value) { value += IsNext() ? "x" : ""; }
  template <typename Number>
  requires std::is_integral_v<Number>
  void Visit(Number& value) { value = static_cast<Number>(value + (IsNext() ? 1 : 0)); }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void Visit(Enum& value) {
    value = static_cast<Enum>(static_cast<int>(value) + (IsNext() ? 1 : 0));
  }
  template <typename Value>
  void Visit(std::optional<Value>& value) {
    if (IsNext()) {
      value = value.has_value() ? std::nullopt : std::optional<Value>(std::in_place);
    } else if (value.has_value()) {
      Visit(*value);
    }
  }
  template <typename Value>
  void Visit(std::vector<Value>& values) {
    for (Value& value : values) {
      Visit(value);
    }
    if (IsNext()) {
      values.push_back(Value(values.back()));
    }
  }

  void Visit(math::Vec3d& v) { VisitAll(v.x, v.y, v.z); }
  void Visit(math::Box3d& box) { VisitAll(box.min, box.max); }
  // Most colours are opaque.
  void Visit(image::Rgba8& color) { VisitAll(color.r, color.g, color.b); }
  void Visit(volume::InsideRule& rule) {
    auto& [isovalue, labels, smooths] = rule;
    if (labels.empty()) {
      return Visit(isovalue);
    }
    Visit(smooths);
    for (double& label : labels) {
      Visit(label);
    }
  }
  void Visit(frame::Appearance& appearance) {
    auto& [base_color, ambient, diffuse, specular, shininess] = appearance;
    VisitAll(base_color, ambient, diffuse, specular, shininess);
  }
  void Visit(frame::ColorRange& range) {
    auto& [min, max] = range;
    VisitAll(min, max);
  }
  void Visit(frame::ColorBy& color_by) {
    // Agents get numbers: the coordinator resolves `range_source`.
    auto& [quantity, map, range, opacity_at_min, opacity_at_max, field, component, range_source] =
        color_by;
    VisitAll(map, range, opacity_at_min, opacity_at_max);
    if (quantity == frame::ColorBy::Quantity::kField) {
      VisitAll(field, component);
    } else {
      Visit(quantity);
    }
  }
  void Visit(frame::Surface& surface) {
    auto& [rule, appearance, color_by, opacity] = surface;
    VisitAll(rule, appearance, color_by, opacity);
  }
  void Visit(view::Camera& camera) {
    auto& [eye, target, up, projection, fov_y_radians, view_height] = camera;
    VisitAll(eye, target, up);
    if (IsNext()) {
      fov_y_radians /= 2;  // stays the angle of a message
    }
    if (IsNext()) {
      projection = view::Projection::kOrthographic;
      fov_y_radians = 0;
      view_height = 7;
    }
  }
  void Visit(view::Viewport& viewport) {
    auto& [width_px, height_px] = viewport;
    VisitAll(width_px, height_px);
  }
  void Visit(view::Region& region) {
    auto& [x, y, width_px, height_px] = region;
    VisitAll(x, y, width_px, height_px);
  }
  void Visit(view::HalfSpace& half_space) {
    auto& [normal, offset] = half_space;
    VisitAll(normal, offset);
  }
  void Visit(view::ClipRegion& clip) {
    auto& [half_spaces, box] = clip;
    VisitAll(half_spaces, box);
  }
  void Visit(frame::ClipCaps& caps) {
    auto& [map, range, range_source, percentiles] = caps;  // and `percentiles`
    VisitAll(*map, range);
  }
  void Visit(frame::Light& light) {
    auto& [direction, space, intensity, color] = light;
    VisitAll(direction, space, intensity, color);
  }

  const int number_;
  int count_ = 0;
};

frame::FrameSpec RichSpec() {
  const frame::ColorBy by_field{.quantity = frame::ColorBy::Quantity::kField,
                                .map = frame::ColorMap::kMagma,
                                .range = frame::ColorRange{1, 4},
                                .opacity_at_min = 0.5F,
                                .opacity_at_max = 0.25F,
                                .field = "velocity",
                                .component = "x"};
  const frame::ColorBy by_x{.range = frame::ColorRange{-1, 2}, .opacity_at_min = 0.5F};
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = volume::InsideRule::OfIsovalue(3.5),
                    .appearance = {.base_color = {1, 2, 3, 255}, .diffuse = 0.5F},
                    .color_by = by_field,
                    .opacity = 0.3F},
                   {.rule = volume::InsideRule::OfLabels({2, 7}), .color_by = by_x}};
  spec.camera = view::MakeDefaultCamera({{0, 0, 0}, {4, 5, 6}});
  spec.camera->view_height = 0;  // of the other projection
  spec.camera->fov_y_radians = CameraFromProto(ToProto(*spec.camera), "camera")->fov_y_radians;
  spec.viewport = {.width_px = 400, .height_px = 300};
  spec.region = view::Region{10, 20, 30, 40};
  spec.background_color = {9, 8, 7, 6};
  spec.clip = {.half_spaces = {{.normal = {1, 2, 3}, .offset = 0.5}},
               .box = math::Box3d{{0, 0, 0}, {1, 2, 3}}};
  spec.caps = {.map = frame::ColorMap::kTurbo, .range = frame::ColorRange{3, 5}};
  spec.max_layers = 3;
  spec.lights = {{.direction = {1, 2, 3}, .intensity = 2, .color = {10, 20, 30, 255}}};
  spec.ray_seed = static_cast<std::uint64_t>(-9);
  spec.sends_normals = true;
  return spec;
}

TEST(FrameSpecConvertTest, AgentsGetEachValueOfAFrame) {
  const frame::FrameSpec rich = RichSpec();
  OneChange none(-1);
  frame::FrameSpec spec = rich;
  none.Visit(spec);
  ASSERT_EQ(spec, rich);
  EXPECT_GT(none.count(), 80);
  for (int i = -1; i < none.count(); ++i) {
    spec = rich;
    OneChange(i).Visit(spec);
    EXPECT_EQ(spec == rich, i < 0) << "value " << i;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec agent_spec,
                                  FrameSpecFromProto(ToProto(spec)));
    EXPECT_EQ(agent_spec, spec) << "value " << i;
  }
}

TEST(FrameSpecConvertTest, AgentsNeverGetWhatTheCoordinatorAdds) {
  const frame::FrameSpec drawn = RichSpec();
  frame::FrameSpec spec = drawn;
  spec.nan_color = image::Rgba8{1, 2, 3, 255};
  spec.output = {.image_format = frame::ImageFormat::kJpeg, .depth = true};
  spec.effects = {.samples_per_side = 2, .silhouette = frame::Silhouette()};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec agent_spec,
                                FrameSpecFromProto(ToProto(spec)));
  EXPECT_EQ(agent_spec, drawn);
}

// A range of positions, and those of a pick, may have no numbers yet.
TEST(FrameSpecConvertTest, AgentsGetNumbersOfARangeOrNone) {
  frame::FrameSpec spec = RichSpec();
  for (frame::Surface& surface : spec.surfaces) {
    surface.color_by->range_source = frame::RangeSource::kVisible;
  }
  spec.surfaces[1].color_by->range.reset();
  spec.caps->range.reset();
  spec.caps->percentiles.emplace();
  const isoscope::internal::v1::FrameSpec proto = ToProto(spec);
  EXPECT_EQ(proto.surfaces(0).color_by().range().max(), 4);
  EXPECT_EQ(proto.surfaces(0).color_by().range().source(),
            isoscope::v1::ColorRange::SOURCE_UNSPECIFIED);
  EXPECT_FALSE(proto.surfaces(1).color_by().has_range());
  EXPECT_FALSE(proto.caps().has_range());
  spec.caps->percentiles.reset();
  spec.caps->range_source = frame::RangeSource::kStep;
  EXPECT_FALSE(ToProto(spec).caps().has_range());
  ISOSCOPE_EXPECT_OK(FrameSpecFromProto(ToProto(spec)));
}

TEST(FrameSpecConvertTest, HostileFramesOfACoordinatorAreNamed) {
  const isoscope::internal::v1::FrameSpec good = ToProto(RichSpec());
  const auto expect = [&](const char* message, const auto& spoil) {
    isoscope::internal::v1::FrameSpec bad = good;
    spoil(&bad);
    EXPECT_THAT(FrameSpecFromProto(bad),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  };
  expect("surfaces is empty", [](auto* bad) { bad->clear_surfaces(); });
  expect("viewport is not set", [](auto* bad) { bad->clear_viewport(); });
  expect("surfaces[1].labels[0]", [](auto* bad) {
    bad->mutable_surfaces(1)->set_labels(0, std::numeric_limits<double>::quiet_NaN());
  });
  expect("region.width_px is 401", [](auto* bad) { bad->mutable_region()->set_width_px(401); });
  expect("max_layers is 17", [](auto* bad) { bad->set_max_layers(17); });
  expect("caps is set without clip", [](auto* bad) { bad->clear_clip(); });
  expect("level is 24", [](auto* bad) { bad->set_level(24); });
}

// An agent of an earlier version refuses a field that it does not know.
TEST(FrameSpecConvertTest, LevelZeroIsNotOnTheWire) {
  isoscope::internal::v1::FrameSpec proto = ToProto(RichSpec());
  const std::string bytes = proto.SerializeAsString();
  proto.clear_level();
  EXPECT_EQ(proto.SerializeAsString(), bytes);
}

TEST(LevelChoiceTest, BothChoicesArriveAndAnAbsentOneIsNone) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(AskedFrame asked, AskedFrameFromProto(request));
  EXPECT_FALSE(asked.level.has_value());
  for (const view::LevelChoice& choice :
       {view::LevelChoice{.level = 0}, view::LevelChoice{.level = 23},
        view::LevelChoice{.level = std::nullopt, .max_spacing_px = 1.1}}) {
    *request.mutable_level() = ToProto(choice);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(asked, AskedFrameFromProto(request));
    EXPECT_EQ(asked.level, choice);
    EXPECT_EQ(asked.spec.level, 0);  // until the dataset is known
  }
}

TEST(LevelChoiceTest, WrongChoicesAreNamedWithTheirValue) {
  const auto expect = [](const char* message, const auto& spoil) {
    isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
    spoil(request.mutable_level());
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
    EXPECT_THAT(AskedFrameFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  };
  expect("level chooses nothing", [](auto*) {});
  expect("level.level is 24", [](auto* level) { level->set_level(24); });
  expect("level.level is -1", [](auto* level) { level->set_level(-1); });
  expect("level.max_spacing_px is 0", [](auto* level) { level->set_max_spacing_px(0); });
  expect("level.max_spacing_px is -2", [](auto* level) { level->set_max_spacing_px(-2); });
  expect("level.max_spacing_px is inf",
         [](auto* level) { level->set_max_spacing_px(std::numeric_limits<double>::infinity()); });
  expect("level.max_spacing_px is nan",
         [](auto* level) { level->set_max_spacing_px(std::numeric_limits<double>::quiet_NaN()); });
}

TEST(ExportSpecFromProtoTest, MeasuresAreOfLevelZero) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(1);
  request.set_level(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ExportSpec spec, ExportSpecFromProto(request));
  EXPECT_EQ(spec.level, 3);
  request.set_with_measures(true);
  EXPECT_THAT(ExportSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("level is 3")));
  request.set_level(24);
  EXPECT_THAT(ExportSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0 to 23")));
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
}  // namespace isoscope::wire
