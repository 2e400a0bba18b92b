// The shader is compared with the formula of its header, in doubles:
//
// - random scenes of lights, materials and fragments, to one level of colour;
// - closed forms: a matt sphere, the head light, both sides of a surface;
// - quantities in place of colours: normals, positions, maps with opacities, caps;
// - the same bits on every instruction set, for any neighbours and regions.

#include "core/picture/deferred_shading.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <optional>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "hwy/highway.h"
#include "hwy/targets.h"
#include "tests/support/status_matchers.h"

namespace isoscope::picture {
namespace {

using frame::ColorBy;
using frame::Light;
using image::Rgba8;
using math::Vec3d;

constexpr image::FragmentOrder kOrder{.block_count = 10};
constexpr view::Viewport kViewport{320, 200};

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {65, 65, 65};
  geometry.origin = {-32, -32, -32};
  return geometry;
}

// From (0, 0, 200) to the centre, +y up; it shows 80 units of the height there.
view::Camera Camera(view::Projection projection) {
  view::Camera camera;
  camera.eye = {0, 0, 200};
  camera.target = {0, 0, 0};
  camera.up = {0, 1, 0};
  camera.projection = projection;
  camera.fov_y_radians = 2 * std::atan(0.2);
  camera.view_height = 80;
  return camera;
}

view::View MakeView(view::Camera camera, const std::optional<view::Region>& region = {}) {
  absl::StatusOr<view::View> view = view::View::Make(camera, kViewport, Geometry(), region);
  EXPECT_THAT(view, isoscope::testing::IsOk());
  return *std::move(view);
}
view::View MakeView(view::Projection projection) { return MakeView(Camera(projection)); }

frame::FrameSpec SpecOf(const std::vector<Light>& lights, int surface_count = 1) {
  frame::FrameSpec spec;
  spec.surfaces.resize(static_cast<std::size_t>(surface_count));
  spec.viewport = kViewport;
  spec.lights = lights;
  return spec;
}

// Returns a fragment at the middle of the depths, unless `depth` is given.
NormalFragment FragmentOf(int x, int y, const Vec3d& normal, std::uint32_t surface = 0,
                          float depth = 0.5F) {
  return {.x = x,
          .y = y,
          .key = image::FragmentKey(depth, kOrder.OwnerOf(surface, 3)),
          .normal = image::EncodeNormal({normal.x, normal.y, normal.z})};
}

Rgba8 ShadeOne(const DeferredShader& shader, const NormalFragment& fragment) {
  std::array<Rgba8, 1> color{};
  shader.Shade(std::array{fragment}, color);
  return color[0];
}

int LargestDifference(const Rgba8& a, const Rgba8& b) {
  return std::max(
      {std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b), std::abs(a.a - b.a)});
}

// The formula of deferred_shading.h, in doubles and without tables. For plain surfaces.
Rgba8 Expected(const frame::FrameSpec& spec, const view::View& view, const NormalFragment& f) {
  const frame::Appearance& look = spec.surfaces[kOrder.SurfaceOf(image::OwnerOf(f.key))].appearance;
  const view::Camera& camera = view.camera();
  Vec3d ray = view.forward();
  if (camera.projection == view::Projection::kPerspective) {
    const double pixel = 2 * std::tan(camera.fov_y_radians / 2) / kViewport.height_px;
    ray = ray + view.right() * (pixel * (view.region().x + f.x + 0.5 - kViewport.width_px / 2.0)) -
          view.up() * (pixel * (view.region().y + f.y + 0.5 - kViewport.height_px / 2.0));
  }
  const Vec3d v = -math::Normalized(ray);
  const std::array<float, 3> decoded = image::DecodeNormal(f.normal);
  Vec3d n{static_cast<double>(decoded[0]), static_cast<double>(decoded[1]),
          static_cast<double>(decoded[2])};
  if (f.normal == image::kNoNormal) {
    n = v;
  }
  n = math::Dot(n, v) < 0 ? -n : n;
  Vec3d diffuse;
  Vec3d specular;
  const auto add = [&](const Vec3d& l, const Vec3d& strength) {
    const double d = math::Dot(n, l);
    if (d > 0) {
      diffuse = diffuse + strength * d;
      specular =
          specular + strength * std::pow(std::max(math::Dot(n, math::Normalized(l + v)), 0.0),
                                         static_cast<double>(look.shininess));
    }
  };
  for (const Light& light : spec.lights) {
    const Vec3d& u = light.direction;
    const Vec3d l = light.space == Light::Space::kWorld
                        ? u
                        : view.right() * u.x + view.up() * u.y - view.forward() * u.z;
    const double scale = static_cast<double>(light.intensity) / 255;
    add(math::Normalized(l), {light.color.r * scale, light.color.g * scale, light.color.b * scale});
  }
  if (spec.lights.empty()) {
    add(v, {1, 1, 1});
  }
  const auto ambient = static_cast<double>(look.ambient);
  const double share = look.diffuse ? static_cast<double>(*look.diffuse) : 1 - ambient;
  const auto channel = [&](std::uint8_t base, double d, double s) {
    const double value =
        base / 255.0 * (ambient + share * d) + static_cast<double>(look.specular) * s;
    return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 1.0) * 255));
  };
  return {channel(look.base_color.r, diffuse.x, specular.x),
          channel(look.base_color.g, diffuse.y, specular.y),
          channel(look.base_color.b, diffuse.z, specular.z), look.base_color.a};
}

// A random request of up to four lights and three materials, and fragments of all kinds.
class RandomScene {
 public:
  explicit RandomScene(std::uint64_t seed) : seed_(seed) {
    spec = SpecOf({}, 3);
    for (frame::Surface& surface : spec.surfaces) {
      frame::Appearance& look = surface.appearance;
      look.base_color = {Byte(), Byte(), Byte(), 255};
      look.ambient = static_cast<float>(Unit());
      if (Unit() < 0.5) {
        look.diffuse = static_cast<float>(Unit());
      }
      look.specular = static_cast<float>(Unit());
      look.shininess = static_cast<float>(std::pow(1000, Unit()));
    }
    for (auto count = static_cast<int>(5 * Unit()); count > 0; --count) {
      spec.lights.push_back({.direction = Direction() * (0.1 + 10 * Unit()),
                             .space = Unit() < 0.5 ? Light::Space::kView : Light::Space::kWorld,
                             .intensity = static_cast<float>(2 * Unit()),
                             .color = {Byte(), Byte(), Byte(), 255}});
    }
    view::Camera camera =
        Camera(Unit() < 0.5 ? view::Projection::kPerspective : view::Projection::kOrthographic);
    camera.eye = Direction() * 200.0;
    camera.up = Direction();
    view = MakeView(camera);
    for (int i = 0; i < 700; ++i) {
      fragments.push_back(FragmentOf(
          static_cast<int>(kViewport.width_px * Unit()),
          static_cast<int>(kViewport.height_px * Unit()), Unit() < 0.05 ? Vec3d() : Direction(),
          static_cast<std::uint32_t>(3 * Unit()), static_cast<float>(Unit())));
    }
  }

  frame::FrameSpec spec;
  view::View view = MakeView(view::Projection::kPerspective);
  std::vector<NormalFragment> fragments;

 private:
  double Unit() { return base::RandomUnit(seed_, counter_++); }
  std::uint8_t Byte() { return static_cast<std::uint8_t>(256 * Unit()); }
  Vec3d Direction() {
    while (true) {
      const Vec3d v{2 * Unit() - 1, 2 * Unit() - 1, 2 * Unit() - 1};
      if (const double length = math::Length(v); length > 0.1 && length <= 1) {
        return v * (1 / length);
      }
    }
  }

  std::uint64_t seed_;
  std::uint64_t counter_ = 0;
};

std::vector<Rgba8> ShadeAll(const RandomScene& scene) {
  std::vector<Rgba8> colors(scene.fragments.size());
  DeferredShader(scene.spec, scene.view, kOrder).Shade(scene.fragments, colors);
  return colors;
}

TEST(DeferredShadingTest, OnlyLightsAndQuantitiesNeedIt) {
  frame::FrameSpec spec = SpecOf({});
  EXPECT_FALSE(NeedsDeferredShading(spec));
  spec.surfaces[0].color_by.emplace();
  EXPECT_TRUE(NeedsDeferredShading(spec));
  EXPECT_TRUE(NeedsDeferredShading(SpecOf({Light()})));
}

TEST(DeferredShadingTest, RandomScenesAreTheFormulaToOneLevel) {
  std::int64_t different_count = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const RandomScene scene(seed);
    const std::vector<Rgba8> colors = ShadeAll(scene);
    for (std::size_t i = 0; i < colors.size(); ++i) {
      const Rgba8 expected = Expected(scene.spec, scene.view, scene.fragments[i]);
      ASSERT_LE(LargestDifference(colors[i], expected), 1) << "seed " << seed << ", " << i;
      different_count += colors[i] == expected ? 0 : 1;
    }
  }
  EXPECT_LT(different_count, 40 * 700 / 100) << "rounding should rarely show";
}

TEST(DeferredShadingTest, EveryInstructionSetGivesTheSameBits) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    RandomScene scene(seed);
    scene.spec.surfaces[1].color_by = ColorBy{.quantity = ColorBy::Quantity::kNormal};
    std::vector<Rgba8> expected;
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      SCOPED_TRACE(absl::StrCat(hwy::TargetName(target), ", seed ", seed));
      hwy::SetSupportedTargetsForTest(target);
      const std::vector<Rgba8> colors = ShadeAll(scene);
      if (expected.empty()) {
        expected = colors;
      }
      ASSERT_EQ(colors, expected);
    }
  }
}

TEST(DeferredShadingTest, AFragmentsColorDoesNotDependOnItsNeighbours) {
  const RandomScene scene(3);
  const std::vector<Rgba8> colors = ShadeAll(scene);
  const DeferredShader shader(scene.spec, scene.view, kOrder);
  for (std::size_t i = 0; i < colors.size(); i += 7) {
    ASSERT_EQ(ShadeOne(shader, scene.fragments[i]), colors[i]) << i;
  }
}

// A sphere seen along -z under a light at 45 degrees: the textbook formula of a matt one.
TEST(DeferredShadingTest, AMattSphereIsTheCosineOfTheLight) {
  constexpr double kRadiusPx = 80;
  frame::FrameSpec spec = SpecOf({{.direction = {1, 0, 1}, .space = Light::Space::kView}});
  spec.surfaces[0].appearance = {
      .base_color = {255, 255, 255, 255}, .ambient = 0, .diffuse = 1.0F, .specular = 0};
  const DeferredShader shader(spec, MakeView(view::Projection::kOrthographic), kOrder);
  int dark_count = 0;
  for (int y = 20; y < 180; ++y) {
    for (int x = 80; x < 240; ++x) {
      const double nx = (x + 0.5 - 160) / kRadiusPx;
      const double ny = -(y + 0.5 - 100) / kRadiusPx;
      if (nx * nx + ny * ny >= 1) {
        continue;
      }
      const double nz = std::sqrt(1 - nx * nx - ny * ny);
      const double cosine = std::max((nx + nz) / std::numbers::sqrt2, 0.0);
      const Rgba8 color = ShadeOne(shader, FragmentOf(x, y, {nx, ny, nz}));
      ASSERT_NEAR(color.r, 255 * cosine, 1) << x << ", " << y;
      ASSERT_EQ(color.r, color.g);
      dark_count += color.r == 0 ? 1 : 0;
    }
  }
  // The terminator is half an ellipse with an axis of cos 45 degrees.
  const double disc = std::numbers::pi * kRadiusPx * kRadiusPx;
  EXPECT_NEAR(dark_count, disc / 2 * (1 - 1 / std::numbers::sqrt2), 0.01 * disc);
}

TEST(DeferredShadingTest, ALightAlongTheViewAxisLooksLikeTheHeadLight) {
  const view::View view = MakeView(view::Projection::kOrthographic);
  const DeferredShader head(SpecOf({}), view, kOrder);
  const DeferredShader light(SpecOf({Light()}), view, kOrder);
  const DeferredShader world(SpecOf({{.direction = {0, 0, 3}, .space = Light::Space::kWorld}}),
                             view, kOrder);
  for (int degrees = 0; degrees <= 180; ++degrees) {
    const double angle = degrees * std::numbers::pi / 180;
    const NormalFragment fragment = FragmentOf(degrees, 50, {std::sin(angle), 0, std::cos(angle)});
    const Rgba8 color = ShadeOne(head, fragment);
    EXPECT_LE(LargestDifference(color, ShadeOne(light, fragment)), 1) << degrees;
    EXPECT_LE(LargestDifference(color, ShadeOne(world, fragment)), 1) << degrees;
    // The colour that agents draw without lights (core/render).
    const double c = std::abs(std::cos(angle));
    const double expected = 222 / 255.0 * (0.12 + 0.88 * c) + 0.22 * std::pow(c, 32);
    EXPECT_NEAR(color.r, 255 * std::min(expected, 1.0), 1) << degrees;
  }
}

TEST(DeferredShadingTest, BothSidesAreLitAlikeAndALightFromBehindLeavesTheAmbientShare) {
  const view::View view = MakeView(view::Projection::kPerspective);
  const DeferredShader front(SpecOf({{.direction = {0.3, 0.4, 1}}}), view, kOrder);
  const Vec3d normal{0.1, -0.2, 0.9};
  EXPECT_EQ(ShadeOne(front, FragmentOf(100, 50, normal)),
            ShadeOne(front, FragmentOf(100, 50, -normal)));
  frame::FrameSpec spec = SpecOf({{.direction = {0, 0, -1}}});
  spec.surfaces[0].appearance = {.base_color = {200, 100, 50, 255}, .ambient = 0.5F};
  EXPECT_EQ(ShadeOne(DeferredShader(spec, view, kOrder), FragmentOf(160, 100, {0, 0, 1})),
            (Rgba8{100, 50, 25, 255}));
}

TEST(DeferredShadingTest, ASurfaceWithoutANormalFacesTheEye) {
  const view::View view = MakeView(view::Projection::kOrthographic);
  const DeferredShader shader(SpecOf({{.direction = {1, 2, 2}, .intensity = 0.5F}}), view, kOrder);
  EXPECT_EQ(ShadeOne(shader, FragmentOf(7, 9, {0, 0, 0})),
            ShadeOne(shader, FragmentOf(7, 9, {0, 0, 1})));
}

TEST(DeferredShadingTest, LightsAddUpWithTheirColorsAndBrightOnesAreClamped) {
  frame::FrameSpec spec =
      SpecOf({{.direction = {0, 0, 1}, .intensity = 0.5F, .color = {255, 0, 0, 255}},
              {.direction = {0, 0, 1}, .color = {0, 0, 255, 255}}});
  spec.surfaces[0].appearance = {
      .base_color = {200, 200, 200, 255}, .ambient = 0, .diffuse = 1.0F, .specular = 0};
  const view::View view = MakeView(view::Projection::kOrthographic);
  const NormalFragment facing = FragmentOf(1, 1, {0, 0, 1});
  EXPECT_EQ(ShadeOne(DeferredShader(spec, view, kOrder), facing), (Rgba8{100, 0, 200, 255}));
  spec.lights[1].intensity = 10;
  EXPECT_EQ(ShadeOne(DeferredShader(spec, view, kOrder), facing), (Rgba8{100, 0, 255, 255}));
}

TEST(DeferredShadingTest, TheNormalItselfIsAColorThatKnowsItsSide) {
  frame::FrameSpec spec = SpecOf({});
  spec.surfaces[0].appearance = {.ambient = 1, .diffuse = 0.0F, .specular = 0};
  spec.surfaces[0].color_by = ColorBy{.quantity = ColorBy::Quantity::kNormal};
  const DeferredShader shader(spec, MakeView(view::Projection::kPerspective), kOrder);
  EXPECT_EQ(ShadeOne(shader, FragmentOf(9, 9, {1, 0, 0})), (Rgba8{255, 128, 128, 255}));
  EXPECT_EQ(ShadeOne(shader, FragmentOf(9, 9, {0, -1, 0})), (Rgba8{128, 0, 128, 255}));
  EXPECT_EQ(ShadeOne(shader, FragmentOf(9, 9, {0, 0, 1})), (Rgba8{128, 128, 255, 255}));
  EXPECT_EQ(ShadeOne(shader, FragmentOf(9, 9, {0, 0, -1})), (Rgba8{128, 128, 0, 255}));
  EXPECT_EQ(ShadeOne(shader, FragmentOf(9, 9, {0, 0, 0})), (Rgba8{128, 128, 128, 255}));
}

TEST(DeferredShadingTest, APositionHasItsColorOfTheMap) {
  frame::FrameSpec spec = SpecOf({}, 4);
  using Quantity = ColorBy::Quantity;
  for (std::size_t i = 0; i < 4; ++i) {
    spec.surfaces[i].appearance = {
        .base_color = {1, 2, 3, 77}, .ambient = 1, .diffuse = 0.0F, .specular = 0};
    spec.surfaces[i].color_by =
        ColorBy{.quantity = static_cast<Quantity>(i % 3), .map = frame::ColorMap::kTurbo};
  }
  spec.surfaces[3].color_by->range = frame::ColorRange{10, 12};
  for (const view::Projection projection :
       {view::Projection::kPerspective, view::Projection::kOrthographic}) {
    const view::View view = MakeView(projection);
    const DeferredShader shader(spec, view, kOrder);
    const view::Unprojection unprojection(view);
    for (int i = 0; i < 200; ++i) {
      const float depth = static_cast<float>(i) / 200;
      const float distance = unprojection.DistanceOf(depth);
      const Vec3d p = unprojection.PositionOf(i, 150 - i / 2, distance);
      for (std::uint32_t surface = 0; surface < 4; ++surface) {
        const double share =
            surface == 3 ? (p.x - 10) / 2 : (p[static_cast<int>(surface)] + 32) / 64;
        Rgba8 expected = ColorMapTableOf(frame::ColorMap::kTurbo)[static_cast<std::size_t>(
            std::clamp(std::floor(256 * share), 0.0, 255.0))];
        expected.a = 77;
        ASSERT_EQ(ShadeOne(shader, FragmentOf(i, 150 - i / 2, {0, 0, 1}, surface, depth)), expected)
            << surface << ", " << i;
      }
    }
  }
}

TEST(DeferredShadingTest, AMapWithOpacitiesLeavesItsStepInAlpha) {
  frame::FrameSpec spec = SpecOf({}, 1);
  spec.surfaces[0].color_by = ColorBy{.quantity = ColorBy::Quantity::kPositionX,
                                      .map = frame::ColorMap::kGrey,
                                      .opacity_at_max = 0.5F};
  spec.surfaces[0].appearance = {.ambient = 1, .diffuse = 0.0F, .specular = 0};
  const DeferredShader shader(spec, MakeView(view::Projection::kOrthographic), kOrder);
  for (int x = 0; x < kViewport.width_px; ++x) {
    const Rgba8 color = ShadeOne(shader, FragmentOf(x, 40, {0, 0, 1}));
    ASSERT_EQ(color.a, color.r) << "the grey map's colours are its steps, at " << x;
  }
}

// A fragment of a surface that shows a field: without a step its value is missing.
NormalFragment ValueFragment(int x, const std::optional<std::uint8_t>& step,
                             std::uint32_t surface = 0) {
  NormalFragment fragment = FragmentOf(x, 40, {0, 0, 1}, surface);
  fragment.normal = step.has_value() ? image::EncodeNormalAndStep(fragment.normal, *step)
                                     : image::EncodeNormalWithoutStep(fragment.normal);
  return fragment;
}

frame::FrameSpec SpecOfField(frame::ColorMap map) {
  frame::FrameSpec spec = SpecOf({});
  spec.surfaces[0].color_by =
      ColorBy{.quantity = ColorBy::Quantity::kField, .map = map, .range = frame::ColorRange{0, 1}};
  spec.surfaces[0].appearance = {.ambient = 1, .diffuse = 0.0F, .specular = 0};
  return spec;
}

// Symptom: missing values had the map's greatest colour.
TEST(DeferredShadingTest, AMissingValueHasAColorThatIsNotOfTheMap) {
  const view::View view = MakeView(view::Projection::kOrthographic);
  for (int i = 0; i < 6; ++i) {
    const auto map = static_cast<frame::ColorMap>(i);
    frame::FrameSpec spec = SpecOfField(map);
    const DeferredShader shader(spec, view, kOrder);
    const Rgba8 missing = ShadeOne(shader, ValueFragment(3, std::nullopt));
    const bool has_grey = map == frame::ColorMap::kGrey || map == frame::ColorMap::kCividis;
    EXPECT_EQ(missing, has_grey ? (Rgba8{128, 0, 128, 255}) : (Rgba8{128, 128, 128, 255})) << i;
    for (const Rgba8& color : ColorMapTableOf(map)) {
      EXPECT_GT(LargestDifference(color, missing), 20) << i;
    }
    spec.nan_color = Rgba8{1, 2, 3, 255};
    EXPECT_EQ(ShadeOne(DeferredShader(spec, view, kOrder), ValueFragment(3, std::nullopt)),
              (Rgba8{1, 2, 3, 255}));
    EXPECT_EQ(ShadeOne(DeferredShader(spec, view, kOrder), ValueFragment(3, 255)),
              ColorMapTableOf(map)[255]);
  }
}

TEST(DeferredShadingTest, AMissingValueIsLitAsTheSurfaceIs) {
  frame::FrameSpec spec = SpecOfField(frame::ColorMap::kViridis);
  spec.surfaces[0].appearance = {.ambient = 0.5F, .specular = 0};
  spec.lights = {{.direction = {0, 0, -1}}};
  const DeferredShader shader(spec, MakeView(view::Projection::kOrthographic), kOrder);
  EXPECT_EQ(ShadeOne(shader, ValueFragment(3, std::nullopt)), (Rgba8{64, 64, 64, 255}));
}

TEST(DeferredShadingTest, AMissingValueHasTheOpacityOfTheMoreOpaqueEnd) {
  frame::FrameSpec spec = SpecOfField(frame::ColorMap::kViridis);
  const view::View view = MakeView(view::Projection::kOrthographic);
  const auto alpha_of = [&](float at_min, float at_max) {
    spec.surfaces[0].color_by->opacity_at_min = at_min;
    spec.surfaces[0].color_by->opacity_at_max = at_max;
    const DeferredShader shader(spec, view, kOrder);
    const NormalFragment fragment = ValueFragment(3, std::nullopt);
    EXPECT_EQ(shader.OpacityStepOf(fragment), ShadeOne(shader, fragment).a);
    EXPECT_EQ(shader.OpacityStepOf(ValueFragment(3, 77)), 77U);
    return ShadeOne(shader, fragment).a;
  };
  EXPECT_EQ(alpha_of(0, 0.5F), 255);
  EXPECT_EQ(alpha_of(0.75F, 0.5F), 0);
  EXPECT_EQ(alpha_of(0.25F, 0.25F), 255);
}

TEST(DeferredShadingTest, ACapWithoutASampleGetsTheColorOfMissingValues) {
  frame::FrameSpec spec = SpecOf({{.direction = {1, 2, 3}}}, 2);
  spec.caps = frame::ClipCaps{.map = frame::ColorMap::kGrey, .range = frame::ColorRange{0, 1}};
  image::FrameImage image(kViewport.width_px, kViewport.height_px);
  // The code of the normal (0, 0, 1) has the same bits as a cap without a sample.
  const NormalFragment plain = FragmentOf(5, 6, {0, 0, 1}, 1);
  ASSERT_EQ(plain.normal, kNoSample);
  image.Set(5, 6, plain.key, plain.normal);
  image.Set(7, 6, FragmentOf(7, 6, {0, 0, 1}, 3).key, kNoSample);
  const DeferredShader shader(spec, MakeView(view::Projection::kPerspective), kOrder);
  shader.ShadeImage(&image);
  EXPECT_EQ(image.colors[image.IndexOf(5, 6)], ShadeOne(shader, plain));
  EXPECT_EQ(image.colors[image.IndexOf(7, 6)], (Rgba8{128, 0, 128, 255}));
}

// An image with a fragment at every third pixel, and pixels that are covered but background.
image::FrameImage ImageOf(const RandomScene& scene, const view::Region& region) {
  image::FrameImage image(region.width_px, region.height_px);
  for (int y = 0; y < region.height_px; ++y) {
    for (int x = 0; x < region.width_px; ++x) {
      const int of_whole = (region.y + y) * kViewport.width_px + region.x + x;
      const NormalFragment& fragment =
          scene.fragments[static_cast<std::size_t>(of_whole) % scene.fragments.size()];
      if (of_whole % 3 == 0) {
        image.Set(x, y, fragment.key, fragment.normal);
      }
    }
  }
  image.CoverAll();
  return image;
}

TEST(DeferredShadingTest, AnImageIsItsFragmentsAndTheBackgroundStays) {
  const RandomScene scene(11);
  const DeferredShader shader(scene.spec, scene.view, kOrder);
  const image::FrameImage normals = ImageOf(scene, scene.view.region());
  image::FrameImage image = normals;
  shader.ShadeImage(&image);
  EXPECT_EQ(image.keys, normals.keys);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t i = image.IndexOf(x, y);
      const Rgba8 expected = normals.keys[i] == image::kBackgroundKey
                                 ? Rgba8()
                                 : ShadeOne(shader, {x, y, normals.keys[i], normals.colors[i]});
      ASSERT_EQ(image.colors[i], expected) << x << ", " << y;
    }
  }
}

TEST(DeferredShadingTest, CapsWithSamplesKeepTheirColorAndGetTheirSurface) {
  frame::FrameSpec spec = SpecOf({{.direction = {1, 2, 3}}}, 2);
  spec.caps = frame::ClipCaps{.map = frame::ColorMap::kGrey};
  image::FrameImage image(kViewport.width_px, kViewport.height_px);
  const NormalFragment plain = FragmentOf(5, 6, {0, 0, 1}, 1);
  image.Set(5, 6, plain.key, plain.normal);
  image.Set(7, 6, FragmentOf(7, 6, {0, 0, 1}, 3).key, {9, 8, 7, 255});
  image.Set(8, 6, FragmentOf(8, 6, {0, 0, 1}, 2).key, {9, 9, 9, 255});
  const DeferredShader shader(spec, MakeView(view::Projection::kPerspective), kOrder);
  shader.ShadeImage(&image);
  EXPECT_EQ(image.colors[image.IndexOf(5, 6)], ShadeOne(shader, plain));
  EXPECT_EQ(image.keys[image.IndexOf(5, 6)], plain.key);
  EXPECT_EQ(image.colors[image.IndexOf(7, 6)], (Rgba8{9, 8, 7, 255}));
  EXPECT_EQ(image.keys[image.IndexOf(7, 6)], FragmentOf(7, 6, {0, 0, 1}, 1).key);
  EXPECT_EQ(image.keys[image.IndexOf(8, 6)], FragmentOf(8, 6, {0, 0, 1}, 0).key);
}

TEST(DeferredShadingTest, ARegionHasTheWholesColors) {
  RandomScene scene(12);
  scene.spec.surfaces[1].color_by = ColorBy{.quantity = ColorBy::Quantity::kPositionX};
  image::FrameImage whole = ImageOf(scene, scene.view.region());
  DeferredShader(scene.spec, scene.view, kOrder).ShadeImage(&whole);
  const view::Region region{37, 21, 150, 90};
  image::FrameImage part = ImageOf(scene, region);
  DeferredShader(scene.spec, MakeView(scene.view.camera(), region), kOrder).ShadeImage(&part);
  for (int y = 0; y < region.height_px; ++y) {
    for (int x = 0; x < region.width_px; ++x) {
      ASSERT_EQ(part.colors[part.IndexOf(x, y)],
                whole.colors[whole.IndexOf(region.x + x, region.y + y)])
          << x << ", " << y;
    }
  }
}

TEST(DeferredShadingTest, AnyBitsOfANormalGiveAColor) {
  const DeferredShader shader(SpecOf({Light(), {.direction = {0, 0, -1}}}),
                              MakeView(view::Projection::kPerspective), kOrder);
  std::vector<NormalFragment> fragments;
  for (std::uint64_t i = 0; i < 100000; ++i) {
    const auto bits = static_cast<std::uint32_t>(base::RandomBits(5, i));
    NormalFragment fragment = FragmentOf(3, 4, {0, 0, 1});
    fragment.normal = {static_cast<std::uint8_t>(bits), static_cast<std::uint8_t>(bits >> 8),
                       static_cast<std::uint8_t>(bits >> 16),
                       static_cast<std::uint8_t>(bits >> 24)};
    fragments.push_back(fragment);
  }
  std::vector<Rgba8> colors(fragments.size());
  shader.Shade(fragments, colors);
  EXPECT_TRUE(
      std::all_of(colors.begin(), colors.end(), [](const Rgba8& color) { return color.a == 255; }));
}

}  // namespace
}  // namespace isoscope::picture
