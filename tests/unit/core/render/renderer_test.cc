// The contract of renderer.h, for both back ends (RendererTest):
//
// - the picture does not depend on order, passes, batches, blocks, threads or earlier frames;
// - equal depths are decided by the tie rule;
// - geometry and shading agree with closed forms: spheres, planes, a head light;
// - limits and errors: cancelled frames, memory, masks, odd sizes.
//
// Tests of the CPU back end alone follow, and one that compares the two.

#include "core/render/renderer.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/monotonic_time.h"
#include "core/base/task_arena.h"
#include "core/composite/depth_composite.h"
#include "core/image/normal_code.h"
#include "core/render/cpu_renderer.h"
#include "core/render/egl_renderer.h"
#include "core/render/renderer_factory.h"
#include "core/view/unprojection.h"
#include "hwy/targets.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/render/test_scenes.h"

namespace isoscope::render {
namespace {

using image::FrameImage;
using image::kFarDepth;
using image::kNoOwner;
using image::Rgba8;
using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr math::Vec3f kTowardEye{0, 0, 1};

// Makes a renderer that draws or shades once it holds this many bytes of meshes.
absl::StatusOr<std::unique_ptr<Renderer>> MakeWithBatches(RendererKind kind, std::size_t bytes) {
  if (kind == RendererKind::kCpu) {
    return MakeCpuRenderer(bytes);
  }
  return EglRenderer::Make({.batch_bytes = bytes});
}

// The contract of both back ends. One renderer for all tests of a back end: starting Mesa takes a
// while.
// A frame of one surface.
frame::FrameSpec SpecOf(const frame::Appearance& appearance = {}) {
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = 0}, .appearance = appearance}};
  return spec;
}

// Adds meshes one by one, and shades whenever the pass is full. Returns how often it was.
int AddAll(const std::vector<MeshPtr>& meshes, RenderPass* pass) {
  int full_count = 0;
  for (const MeshPtr& mesh : meshes) {
    EXPECT_THAT(pass->Add(mesh), IsOk());
    if (pass->is_full()) {
      ++full_count;
      EXPECT_THAT(pass->Shade(base::Cancellation()), IsOk());
      EXPECT_FALSE(pass->is_full());
    }
  }
  return full_count;
}

class RendererTest : public ::testing::TestWithParam<RendererKind> {
 protected:
  void SetUp() override {
    std::unique_ptr<Renderer>& renderer = renderers_[GetParam()];
    if (renderer == nullptr) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(renderer, MakeRenderer({.kind = GetParam()}));
    }
    renderer_ = renderer.get();
  }
  static void TearDownTestSuite() { renderers_.clear(); }

  [[nodiscard]] image::FragmentOrder OrderOf(const volume::BlockLayout& layout) const {
    return {.block_count = static_cast<std::uint32_t>(layout.block_count()),
            .ties = frame::TieRuleOf(renderer_->picture_revision().back_end)};
  }

  static FrameImage Draw(Renderer* renderer, const view::View& view,
                         const volume::BlockLayout& layout, const std::vector<MeshPtr>& meshes,
                         const frame::Appearance& appearance = {}) {
    auto pass = renderer->BeginPass(view, layout, SpecOf(appearance));
    EXPECT_THAT(pass, IsOk());
    AddAll(meshes, pass->get());
    const base::Cancellation never;
    auto image = (*pass)->Finish(never);
    EXPECT_THAT(image, IsOk());
    return image.ok() ? *std::move(image) : FrameImage();
  }
  FrameImage Draw(const view::View& view, const volume::BlockLayout& layout,
                  const std::vector<MeshPtr>& meshes, const frame::Appearance& appearance = {}) {
    return Draw(renderer_, view, layout, meshes, appearance);
  }

  static std::map<RendererKind, std::unique_ptr<Renderer>> renderers_;
  Renderer* renderer_ = nullptr;
};

std::map<RendererKind, std::unique_ptr<Renderer>> RendererTest::renderers_;

std::size_t PixelIndex(const FrameImage& image, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
         static_cast<std::size_t>(x);
}

std::int64_t CoveredCount(const FrameImage& image) {
  return std::count_if(image.keys.begin(), image.keys.end(),
                       [](std::uint64_t key) { return image::OwnerOf(key) != kNoOwner; });
}

// A layout of 8^3-cell blocks in a cube of 65 samples, no surface.
Scene EmptyScene() {
  return MakeIsosurface(65, 8, [](const math::Vec3d&) { return -1.0; });
}

TEST_P(RendererTest, PreparedPassesDrawTheSamePicture) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 310, 250, 25, 15);
  const FrameImage expected = Draw(view, scene.layout, scene.meshes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto prepared, MakeRenderer({.kind = GetParam()}));
  prepared->Prepare(view.viewport(), 3, 4);
  EXPECT_EQ(Draw(prepared.get(), view, scene.layout, scene.meshes), expected);
  // Larger than it may keep, and of another size.
  prepared->Prepare({.width_px = 4096, .height_px = 4096}, 2, 2);
  EXPECT_EQ(Draw(prepared.get(), view, scene.layout, scene.meshes), expected);
}

// Up to the limits of volume::Validate nothing that is computed in float32 vanishes or overflows: a
// unit that is a power of two larger changes no bit.
TEST_P(RendererTest, TheUnitOfLengthDoesNotMatter) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  for (const view::View& view :
       {MakeView(scene, 155, 125, 25, 15), MakeOrthographicView(scene, 100, 101, 20, {32, 40, 50}),
        MakeOrthographicView(scene, 77, 90, 0.3, {32, 32, 58})}) {
    const FrameImage expected = Draw(view, scene.layout, scene.meshes);
    EXPECT_GT(CoveredCount(expected), 2000);
    for (const int exponent : {-79, -40, 1, 40, 79}) {
      const double unit = std::ldexp(1.0, exponent);
      volume::GridGeometry geometry = view.geometry();
      geometry.spacing = geometry.spacing * unit;
      view::Camera camera = view.camera();
      camera.eye = camera.eye * unit;
      camera.target = camera.target * unit;
      camera.view_height *= unit;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View scaled,
                                    view::View::Make(camera, view.viewport(), geometry));
      EXPECT_TRUE(Draw(scaled, scene.layout, scene.meshes) == expected) << "2^" << exponent;
      std::vector<volume::BlockId> ids(static_cast<std::size_t>(scene.layout.block_count()));
      std::iota(ids.begin(), ids.end(), 0);
      std::vector<view::Footprint> footprints(ids.size());
      scaled.FootprintsOf(scene.layout, ids, absl::MakeSpan(footprints));
      for (const volume::BlockId id : ids) {
        const view::Footprint plain = view.FootprintOf(scene.layout, id);
        ASSERT_EQ(footprints[id].rect, plain.rect) << "2^" << exponent << ", block " << id;
        ASSERT_EQ(footprints[id].nearest_depth, plain.nearest_depth);
      }
    }
  }
}

TEST_P(RendererTest, OrderOfAddingDoesNotMatter) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 300, 240, 25, 15);
  const FrameImage expected = Draw(view, scene.layout, scene.meshes);
  EXPECT_GT(CoveredCount(expected), 5000);
  std::vector<MeshPtr> meshes = scene.meshes;
  std::mt19937 generator(7);
  for (int i = 0; i < 4; ++i) {
    std::shuffle(meshes.begin(), meshes.end(), generator);
    EXPECT_EQ(Draw(view, scene.layout, meshes), expected);
  }
}

TEST_P(RendererTest, SpreadingBlocksOverPassesDoesNotMatter) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 301, 199, -40, 30);
  const FrameImage expected = Draw(view, scene.layout, scene.meshes);
  std::mt19937 generator(8);
  for (const std::size_t pass_count : {2U, 5U, 16U}) {
    std::vector<std::vector<MeshPtr>> passes(pass_count);
    for (const MeshPtr& mesh : scene.meshes) {
      passes[generator() % pass_count].push_back(mesh);
    }
    FrameImage composited(view.viewport().width_px, view.viewport().height_px);
    for (const std::vector<MeshPtr>& meshes : passes) {
      composite::CompositeInto(Draw(view, scene.layout, meshes), OrderOf(scene.layout),
                               &composited);
    }
    EXPECT_EQ(composited, expected) << pass_count;
  }
}

TEST_P(RendererTest, BatchesDoNotShow) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View view = MakeView(scene, 200, 200, 10, 10);
  const FrameImage expected = Draw(view, scene.layout, scene.meshes);
  for (const std::size_t batch_bytes : {std::size_t{1}, std::size_t{200'000}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeWithBatches(GetParam(), batch_bytes));
    EXPECT_EQ(Draw(renderer.get(), view, scene.layout, scene.meshes), expected) << batch_bytes;
  }
}

TEST_P(RendererTest, BlockSizeDoesNotChangeColourOrUnclampedDepth) {
  const Scene small = MakeBumpySphere(48, 4, 18, 1);
  const Scene large = MakeBumpySphere(48, 32, 18, 1);
  const view::View view = MakeView(small, 256, 256, 30, 40);
  const FrameImage a = Draw(view, small.layout, small.meshes);
  const FrameImage b = Draw(view, large.layout, large.meshes);
  std::int64_t different = 0;
  for (std::size_t i = 0; i < a.pixel_count(); ++i) {
    different += a.colors[i] == b.colors[i] ? 0 : 1;
    EXPECT_EQ(image::OwnerOf(a.keys[i]) == kNoOwner, image::OwnerOf(b.keys[i]) == kNoOwner)
        << "a seam at pixel " << i;
  }
  // Only where two triangles meet at one depth may another block's triangle be shown.
  EXPECT_LT(different, CoveredCount(a) / 1000);
}

// Two triangles in one place: the one of the lower block faces the eye and is the lighter one.
struct TiedTriangles {
  MeshPtr low;   // of the lower block, light
  MeshPtr high;  // of the higher block, dark
};
TiedTriangles MakeTiedTriangles(const Scene& scene) {
  const math::Vec3f a{32, 32, 32};
  const math::Vec3f b{28, 32, 32};
  const math::Vec3f c{32, 28, 32};
  return {MakeTriangle(scene.layout.IdOf({3, 3, 3}), a, b, c, kTowardEye),
          MakeTriangle(scene.layout.IdOf({3, 3, 4}), a, b, c, {1, 0, 0})};
}

TEST_P(RendererTest, EqualDepthsGoToTheSmallerColorOrTheLowerBlockWhateverTheOrderOrPass) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {32, 32, 32});
  const auto [low_mesh, high_mesh] = MakeTiedTriangles(scene);
  const FrameImage low_only = Draw(view, scene.layout, {low_mesh});
  const FrameImage high_only = Draw(view, scene.layout, {high_mesh});
  ASSERT_GT(CoveredCount(low_only), 50);
  for (std::size_t i = 0; i < low_only.pixel_count(); ++i) {
    ASSERT_EQ(image::DepthOf(low_only.keys[i]), image::DepthOf(high_only.keys[i])) << i;
  }
  ASSERT_NE(low_only.colors, high_only.colors);
  const bool color_decides = OrderOf(scene.layout).ties == image::TieRule::kColor;
  const FrameImage& expected = color_decides ? high_only : low_only;
  EXPECT_EQ(Draw(view, scene.layout, {low_mesh, high_mesh}), expected);
  EXPECT_EQ(Draw(view, scene.layout, {high_mesh, low_mesh}), expected);
  for (const auto& [into, from] :
       {std::pair(&low_only, &high_only), std::pair(&high_only, &low_only)}) {
    FrameImage composited = *into;
    composite::CompositeInto(*from, OrderOf(scene.layout), &composited);
    EXPECT_EQ(composited, expected);
  }
}

TEST_P(RendererTest, EqualDepthsGoToTheEarlierSurfaceWhateverItsColor) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {32, 32, 32});
  const auto [low_mesh, high_mesh] = MakeTiedTriangles(scene);
  frame::FrameSpec spec = SpecOf();
  spec.surfaces.push_back(spec.surfaces[0]);
  // The lighter triangle, in whichever block it lies, is of the first surface.
  for (const bool is_reversed : {false, true}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass, renderer_->BeginPass(view, scene.layout, spec));
    std::vector<MeshToDraw> meshes(2);
    meshes[0] = {.mesh = high_mesh, .surface_index = 1};
    meshes[1] = {.mesh = low_mesh, .surface_index = 0};
    if (is_reversed) {
      std::swap(meshes[0], meshes[1]);
    }
    ISOSCOPE_ASSERT_OK(pass->Add(meshes));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameImage image, pass->Finish(base::Cancellation()));
    EXPECT_EQ(image, Draw(view, scene.layout, {low_mesh}));
  }
}

TEST_P(RendererTest, SurfacesHaveTheirOwnLookAndOwners) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {32, 32, 32});
  const MeshPtr mesh = MakeTiedTriangles(scene).low;
  frame::Appearance red;
  red.base_color = {200, 10, 10, 255};
  frame::FrameSpec spec = SpecOf();
  spec.surfaces.push_back({.rule = {.isovalue = 1}, .appearance = red});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass, renderer_->BeginPass(view, scene.layout, spec));
  const MeshToDraw second{.mesh = mesh, .surface_index = 1};
  ISOSCOPE_ASSERT_OK(pass->Add(std::span(&second, 1)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameImage image, pass->Finish(base::Cancellation()));
  const FrameImage alone = Draw(view, scene.layout, {mesh}, red);
  EXPECT_EQ(image.colors, alone.colors);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (image.keys[i] != image::kBackgroundKey) {
      EXPECT_EQ(image::OwnerOf(image.keys[i]),
                OrderOf(scene.layout).OwnerOf(1, image::OwnerOf(alone.keys[i])));
    }
  }
}

TEST_P(RendererTest, EqualDepthsInABlockGoToTheSmallerColorOrTheFirstTriangle) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {28, 28, 28});
  mesh::BlockMesh both;
  both.block_id = scene.layout.IdOf({3, 3, 3});
  both.positions = {{26, 26, 28}, {30, 26, 28}, {26, 30, 28},
                    {26, 26, 28}, {30, 26, 28}, {26, 30, 28}};
  both.normals = {kTowardEye, kTowardEye, kTowardEye, {1, 0, 0}, {1, 0, 0}, {1, 0, 0}};
  both.indices = {0, 1, 2, 3, 4, 5};
  mesh::BlockMesh light = both;
  light.indices = {0, 1, 2};
  mesh::BlockMesh dark = both;
  dark.indices = {3, 4, 5};
  mesh::BlockMesh swapped = both;
  swapped.indices = {3, 4, 5, 0, 1, 2};
  const bool color_decides = OrderOf(scene.layout).ties == image::TieRule::kColor;
  const FrameImage light_image = Draw(view, scene.layout, {mesh::Compact(light)});
  const FrameImage dark_image = Draw(view, scene.layout, {mesh::Compact(dark)});
  ASSERT_NE(light_image, dark_image);
  EXPECT_EQ(Draw(view, scene.layout, {mesh::Compact(both)}),
            color_decides ? dark_image : light_image);
  EXPECT_EQ(Draw(view, scene.layout, {mesh::Compact(swapped)}), dark_image);
}

TEST_P(RendererTest, FragmentsKeepToTheFootprintOfTheirBlock) {
  const Scene scene = EmptyScene();
  const view::View view = MakeView(scene, 200, 150, 20, 10);
  const volume::BlockId id = scene.layout.IdOf({4, 4, 4});
  const view::Footprint footprint = view.FootprintOf(scene.layout, id);
  // A triangle that reaches far out of its block on all sides, and nearer to the eye.
  const MeshPtr mesh = MakeTriangle(id, {0, 0, 60}, {64, 0, 60}, {32, 64, 64}, kTowardEye);
  const FrameImage image = Draw(view, scene.layout, {mesh});
  EXPECT_GT(CoveredCount(image), 10);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t i = PixelIndex(image, x, y);
      if (image::OwnerOf(image.keys[i]) == kNoOwner) {
        continue;
      }
      EXPECT_GE(image::DepthOf(image.keys[i]), footprint.nearest_depth);
      EXPECT_GE(x, footprint.rect.begin_x);
      EXPECT_LT(x, footprint.rect.end_x);
      EXPECT_GE(y, footprint.rect.begin_y);
      EXPECT_LT(y, footprint.rect.end_y);
    }
  }
}

TEST_P(RendererTest, NoFragmentOfASurfaceIsNearerThanItsBlock) {
  const Scene scene = MakeBumpySphere(64, 4, 26, 1.5);
  const view::View view = MakeView(scene, 320, 320, 33, -21);
  const FrameImage image = Draw(view, scene.layout, scene.meshes);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (image::OwnerOf(image.keys[i]) != kNoOwner) {
      ASSERT_GE(image::DepthOf(image.keys[i]),
                view.FootprintOf(scene.layout, image::OwnerOf(image.keys[i])).nearest_depth);
      ASSERT_LE(image::DepthOf(image.keys[i]), 1.0F);
    }
  }
}

TEST_P(RendererTest, BackgroundStaysUntouched) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 16, {32, 32, 32});
  const volume::BlockId id = scene.layout.IdOf({4, 4, 4});
  const FrameImage image = Draw(
      view, scene.layout, {MakeTriangle(id, {33, 33, 33}, {36, 33, 33}, {33, 36, 33}, kTowardEye)});
  const std::int64_t covered = CoveredCount(image);
  EXPECT_GT(covered, 20);
  EXPECT_LT(covered, 200);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (image::OwnerOf(image.keys[i]) == kNoOwner) {
      EXPECT_EQ(image::DepthOf(image.keys[i]), kFarDepth);
      EXPECT_EQ(image.colors[i], Rgba8{});
    } else {
      EXPECT_EQ(image::OwnerOf(image.keys[i]), id);
      EXPECT_LT(image::DepthOf(image.keys[i]), kFarDepth);
      EXPECT_EQ(image.colors[i].a, 255);
    }
  }
}

TEST_P(RendererTest, WhatIsTopLeftInTheViewIsTopLeftInTheImage) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 100, 100, 64, {32, 32, 32});
  // x to the right, y up, seen along -z: small x and large y is the top left.
  const volume::BlockId id = scene.layout.IdOf({0, 7, 0});
  const FrameImage image =
      Draw(view, scene.layout, {MakeTriangle(id, {1, 57, 4}, {7, 57, 4}, {1, 63, 4}, kTowardEye)});
  EXPECT_GT(CoveredCount(image), 10);
  for (int y = 0; y < 100; ++y) {
    for (int x = 0; x < 100; ++x) {
      if (image::OwnerOf(image.keys[PixelIndex(image, x, y)]) != kNoOwner) {
        EXPECT_LT(x, 15);
        EXPECT_LT(y, 15);
      }
    }
  }
}

// Pixels that the silhouette of a sphere covers, by the closed form.
double SilhouetteRadiusPx(double radius, double distance, double fov_y_radians, int height) {
  const double tangent = radius / std::sqrt(distance * distance - radius * radius);
  return tangent / std::tan(fov_y_radians / 2) * height / 2;
}

TEST_P(RendererTest, SphereHasTheRadiusOfTheClosedFormInAnyAspect) {
  const double radius = 40;
  const Scene scene = MakeBumpySphere(101, 25, radius, 0);
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{300, 300}, {500, 200}, {160, 320}}) {
    const view::View view = MakeView(scene, width, height);
    const FrameImage image = Draw(view, scene.layout, scene.meshes);
    int min_x = width;
    int max_x = -1;
    int min_y = height;
    int max_y = -1;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        if (image::OwnerOf(image.keys[PixelIndex(image, x, y)]) != kNoOwner) {
          min_x = std::min(min_x, x);
          max_x = std::max(max_x, x);
          min_y = std::min(min_y, y);
          max_y = std::max(max_y, y);
        }
      }
    }
    const view::Camera& camera = view.camera();
    const double expected = SilhouetteRadiusPx(radius, math::Length(camera.eye - camera.target),
                                               camera.fov_y_radians, height);
    ASSERT_LT(expected, width / 2.0);
    // Half a pixel on each side, and the facets lie inside the sphere by less than that.
    EXPECT_NEAR((max_x - min_x + 1) / 2.0, expected, 1.0) << width << " x " << height;
    EXPECT_NEAR((max_y - min_y + 1) / 2.0, expected, 1.0) << width << " x " << height;
    EXPECT_NEAR(static_cast<double>(CoveredCount(image)), std::numbers::pi * expected * expected,
                2 * std::numbers::pi * expected);
  }
}

TEST_P(RendererTest, DepthIsThatOfThePlaneUnderThePixel) {
  const Scene scene = EmptyScene();
  const view::View view = MakeView(scene, 120, 120);
  const volume::BlockId id = scene.layout.IdOf({4, 4, 4});
  const double z = 36;
  const FrameImage image = Draw(
      view, scene.layout, {MakeTriangle(id, {32, 32, 36}, {40, 32, 36}, {32, 40, 36}, kTowardEye)});
  EXPECT_GT(CoveredCount(image), 20);
  // All points of the plane z = 36 have one distance along the view direction, so one depth.
  const math::Vec4d clip = view.clip_from_index() * math::Vec4d{34, 34, z, 1};
  const double expected = 0.5 * clip.z / clip.w + 0.5;
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (image::OwnerOf(image.keys[i]) != kNoOwner) {
      // Some units in the last place of clip.z and clip.w, both below 8 times the depth range.
      EXPECT_NEAR(static_cast<double>(image::DepthOf(image.keys[i])), expected, 4e-6);
    }
  }
}

TEST_P(RendererTest, ShadingIsTheClosedFormAndTwoSided) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {36, 36, 36});
  const volume::BlockId id = scene.layout.IdOf({4, 4, 4});
  const frame::Appearance appearance;
  const auto color_of = [&](const math::Vec3f& normal) {
    const FrameImage image =
        Draw(view, scene.layout,
             {MakeTriangle(id, {32, 32, 36}, {40, 32, 36}, {32, 40, 36}, normal)}, appearance);
    return image.colors[PixelIndex(image, 10, 20)];
  };
  const auto expected_of = [&](float facing) {
    const auto channel = [&](std::uint8_t base) {
      const float value = static_cast<float>(base) / 255.0F *
                              (appearance.ambient + (1 - appearance.ambient) * facing) +
                          appearance.specular * std::pow(facing, appearance.shininess);
      return std::min(value, 1.0F) * 255.0F;
    };
    const Rgba8& base = appearance.base_color;
    return std::vector<float>{channel(base.r), channel(base.g), channel(base.b)};
  };
  for (const float degrees : {0.0F, 20.0F, 45.0F, 80.0F, 90.0F}) {
    const float angle = degrees * std::numbers::pi_v<float> / 180.0F;
    const math::Vec3f normal{std::sin(angle), 0, std::cos(angle)};
    const Rgba8 color = color_of(normal);
    EXPECT_EQ(color, color_of(-normal)) << degrees;
    const std::vector<float> expected = expected_of(std::cos(angle));
    EXPECT_NEAR(static_cast<float>(color.r), expected[0], 1.0F) << degrees;
    EXPECT_NEAR(static_cast<float>(color.g), expected[1], 1.0F) << degrees;
    EXPECT_NEAR(static_cast<float>(color.b), expected[2], 1.0F) << degrees;
  }
  // Where the gradient vanishes the surface is lit as if it faced the eye.
  EXPECT_EQ(color_of({0, 0, 0}), color_of(kTowardEye));
}

TEST_P(RendererTest, PerspectiveHeadLightFollowsTheRayOfThePixel) {
  const Scene scene = MakeBumpySphere(65, 16, 28, 0);
  for (const double azimuth : {0.0, 70.0, 200.0}) {
    const view::View view = MakeView(scene, 201, 201, azimuth);
    const FrameImage image = Draw(view, scene.layout, scene.meshes);
    const Rgba8 center = image.colors[PixelIndex(image, 100, 100)];
    const Rgba8 facing{255, 240, 221, 255};
    EXPECT_NEAR(static_cast<int>(center.g), static_cast<int>(facing.g) + 15, 16);
    // At the silhouette of a sphere normals are at right angles to the ray, on every side alike.
    int first = 0;
    while (image::OwnerOf(image.keys[PixelIndex(image, first, 100)]) == kNoOwner) {
      ++first;
    }
    const Rgba8 left = image.colors[PixelIndex(image, first + 1, 100)];
    const Rgba8 right = image.colors[PixelIndex(image, 200 - first - 1, 100)];
    EXPECT_LT(static_cast<int>(left.g), 110);
    EXPECT_NEAR(static_cast<int>(left.g), static_cast<int>(right.g), 25);
  }
}

TEST_P(RendererTest, ThreadsAndPassesAtATimeDoNotDisturbEachOther) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  std::vector<view::View> views;
  std::vector<FrameImage> expected;
  for (int i = 0; i < 4; ++i) {
    views.push_back(MakeView(scene, 100 + 30 * i, 90, 20.0 * i));
    expected.push_back(Draw(views.back(), scene.layout, scene.meshes));
  }
  std::vector<FrameImage> images(views.size());
  std::vector<std::thread> frames;
  for (std::size_t i = 0; i < views.size(); ++i) {
    frames.emplace_back([&, i]() {
      auto pass = renderer_->BeginPass(views[i], scene.layout, SpecOf());
      ASSERT_THAT(pass, IsOk());
      // Two threads add to the same pass.
      const auto add = [&](std::size_t first) {
        for (std::size_t m = first; m < scene.meshes.size(); m += 2) {
          EXPECT_THAT((*pass)->Add(scene.meshes[m]), IsOk());
        }
      };
      std::thread other(add, 1);
      add(0);
      other.join();
      const base::Cancellation never;
      auto image = (*pass)->Finish(never);
      ASSERT_THAT(image, IsOk());
      images[i] = *std::move(image);
    });
  }
  for (std::thread& frame : frames) {
    frame.join();
  }
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_EQ(images[i], expected[i]) << i;
  }
}

TEST_P(RendererTest, ACancelledFrameEndsWithItsErrorAndLeavesTheNextAlone) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View view = MakeView(scene, 128, 128);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto pass, renderer_->BeginPass(view, scene.layout, SpecOf()));
  for (const MeshPtr& mesh : scene.meshes) {
    ISOSCOPE_ASSERT_OK(pass->Add(mesh));
  }
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(pass->Finish(cancelled), StatusIs(absl::StatusCode::kCancelled, _));

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(pass, renderer_->BeginPass(view, scene.layout, SpecOf()));
  ISOSCOPE_ASSERT_OK(pass->Add(scene.meshes.front()));
  const base::Cancellation late(base::MonotonicNow() - absl::Seconds(1));
  EXPECT_THAT(pass->Finish(late), StatusIs(absl::StatusCode::kDeadlineExceeded, _));

  // A pass that is dropped with a batch in flight.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto small_batches, MakeWithBatches(GetParam(), 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(pass, small_batches->BeginPass(view, scene.layout, SpecOf()));
  ISOSCOPE_ASSERT_OK(pass->Add(scene.meshes.front()));
  pass.reset();
  EXPECT_GT(CoveredCount(Draw(small_batches.get(), view, scene.layout, scene.meshes)), 100);
}

TEST_P(RendererTest, PassesWithoutTrianglesAreBackground) {
  const Scene scene = EmptyScene();
  const view::View view = MakeView(scene, 31, 17);
  EXPECT_EQ(Draw(view, scene.layout, {}), FrameImage(31, 17));
  EXPECT_EQ(Draw(view, scene.layout, {mesh::Compact({})}), FrameImage(31, 17));
}

TEST_P(RendererTest, OddSizesAreDrawn) {
  const Scene scene = MakeBumpySphere(33, 8, 13, 0);
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{1, 1}, {3, 7}, {4096, 16}, {16, 4096}, {1023, 5}}) {
    const view::View view = MakeView(scene, width, height);
    const FrameImage image = Draw(view, scene.layout, scene.meshes);
    ASSERT_EQ(image.width, width);
    ASSERT_EQ(image.height, height);
    EXPECT_NE(image::OwnerOf(image.keys[PixelIndex(image, width / 2, height / 2)]), kNoOwner)
        << width << " x " << height;
    EXPECT_EQ(image.colors.size(), image.pixel_count());
  }
}

TEST_P(RendererTest, FullDepthWinsOverTheBackground) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {36, 36, 36});
  const volume::BlockId id = scene.layout.IdOf({4, 4, 4});
  // Planes from before to behind the far plane in steps of a float's resolution: one of them has
  // depth 1 without being cut off.
  const double far_z = 36 + 1000 - view.far_distance();
  bool depth_one_was_drawn = false;
  for (int step = -20; step <= 20; ++step) {
    const auto z = static_cast<float>(far_z + step * 1e-6);
    const FrameImage image = Draw(
        view, scene.layout, {MakeTriangle(id, {32, 32, z}, {40, 32, z}, {32, 40, z}, kTowardEye)});
    for (std::size_t i = 0; i < image.pixel_count(); ++i) {
      if (image::OwnerOf(image.keys[i]) == kNoOwner) {
        ASSERT_EQ(image.colors[i], Rgba8{}) << z;
      } else {
        ASSERT_NE(image.colors[i], Rgba8{}) << z;
        depth_one_was_drawn = depth_one_was_drawn || image::DepthOf(image.keys[i]) == 1.0F;
      }
    }
  }
  EXPECT_TRUE(depth_one_was_drawn);
}

TEST_P(RendererTest, BlocksThatTheLayoutDoesNotHaveAreRefused) {
  const Scene scene = EmptyScene();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto pass, renderer_->BeginPass(MakeView(scene, 8, 8), scene.layout, SpecOf()));
  EXPECT_THAT(pass->Add(MakeTriangle(512, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, kTowardEye)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("512")));
}

// A mask around the block's footprint that is open at random.
image::PixelMask RandomMask(const view::Footprint& footprint, std::mt19937* generator) {
  image::PixelMask mask;
  mask.shift = static_cast<int>((*generator)() % 4);
  const view::PixelRect& rect = footprint.rect;
  if (rect.empty()) {
    return mask;
  }
  mask.begin_column = rect.begin_x >> mask.shift;
  mask.begin_row = rect.begin_y >> mask.shift;
  mask.columns = ((rect.end_x - 1) >> mask.shift) + 1 - mask.begin_column;
  mask.rows = ((rect.end_y - 1) >> mask.shift) + 1 - mask.begin_row;
  const auto bits = static_cast<std::size_t>(mask.columns) * static_cast<std::size_t>(mask.rows);
  mask.words.resize((bits + 63) / 64);
  for (std::size_t bit = 0; bit < bits; ++bit) {
    mask.words[bit / 64] |= std::uint64_t{(*generator)() % 2} << (bit % 64);
  }
  return mask;
}

TEST_P(RendererTest, FragmentsOutsideTheMaskOfTheirMeshAreDropped) {
  const Scene scene = MakeBumpySphere(32, 8, 12, 1);
  const view::View view = MakeView(scene, 130, 90, 20, 10);
  std::mt19937 generator(11);
  std::vector<std::optional<image::PixelMask>> masks;
  FrameImage expected(130, 90);
  std::int64_t dropped = 0;
  for (const MeshPtr& mesh : scene.meshes) {
    std::optional<image::PixelMask>& mask = masks.emplace_back();
    if (generator() % 3 != 0) {
      mask = RandomMask(view.FootprintOf(scene.layout, mesh->block_id), &generator);
    }
    FrameImage alone = Draw(view, scene.layout, {mesh});
    for (int y = 0; y < 90; ++y) {
      for (int x = 0; x < 130; ++x) {
        if (mask.has_value() && !mask->Contains(x, y)) {
          const std::size_t i = PixelIndex(alone, x, y);
          dropped += alone.keys[i] != image::kBackgroundKey ? 1 : 0;
          alone.keys[i] = image::kBackgroundKey;
          alone.colors[i] = Rgba8{};
        }
      }
    }
    composite::CompositeInto(alone, OrderOf(scene.layout), &expected);
  }
  EXPECT_GT(dropped, 500);
  EXPECT_GT(CoveredCount(expected), 500);
  for (const std::size_t batch_bytes : {std::size_t{1} << 30, std::size_t{1}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeWithBatches(GetParam(), batch_bytes));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                  renderer->BeginPass(view, scene.layout, SpecOf()));
    for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
      ISOSCOPE_ASSERT_OK(pass->Add(scene.meshes[i], masks[i].has_value() ? &*masks[i] : nullptr));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameImage image, pass->Finish(base::Cancellation()));
    EXPECT_EQ(image, expected) << batch_bytes;
  }
}

TEST_P(RendererTest, TouchedTilesAreThoseThatHoldAPixel) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  constexpr int kTilePx = image::TileSet::kTilePx;
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{{301, 199}, {16, 17}}) {
    const view::View view = MakeView(scene, width, height, 20, 30);
    for (const std::size_t stride : {std::size_t{1}, std::size_t{40}}) {
      std::vector<MeshPtr> meshes;
      for (std::size_t i = 0; i < scene.meshes.size(); i += stride) {
        meshes.push_back(scene.meshes[i]);
      }
      const FrameImage image = Draw(view, scene.layout, meshes);
      image::TileSet expected(width, height);
      FrameImage covered(width, height);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          if (image.keys[image.IndexOf(x, y)] != image::kBackgroundKey) {
            expected.Insert(x / kTilePx, y / kTilePx);
            covered.Set(x, y, 0, {});
          } else {
            EXPECT_EQ(image.colors[image.IndexOf(x, y)], Rgba8{});
          }
        }
      }
      EXPECT_EQ(image.touched, expected) << width << " x " << height << ", every " << stride;
      EXPECT_EQ(image.covered, covered.covered) << width << " x " << height << ", every " << stride;
    }
  }
}

TEST_P(RendererTest, NothingOfEarlierPassesShows) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View large = MakeView(scene, 200, 200, 10, 10);
  const view::View other = MakeView(scene, 200, 200, 100, -30);
  const std::vector<MeshPtr> few(scene.meshes.begin(), scene.meshes.begin() + 5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto fresh, MakeWithBatches(GetParam(), 1 << 30));
  const FrameImage expected = Draw(fresh.get(), other, scene.layout, few);
  for (const std::size_t batch_bytes : {std::size_t{1} << 30, std::size_t{1}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeWithBatches(GetParam(), batch_bytes));
    Draw(renderer.get(), large, scene.layout, scene.meshes);
    EXPECT_EQ(Draw(renderer.get(), other, scene.layout, few), expected);
    {
      // An abandoned pass.
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                    renderer->BeginPass(large, scene.layout, SpecOf()));
      for (const MeshPtr& mesh : scene.meshes) {
        ISOSCOPE_ASSERT_OK(pass->Add(mesh));
      }
    }
    EXPECT_EQ(Draw(renderer.get(), other, scene.layout, few), expected);
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                    renderer->BeginPass(large, scene.layout, SpecOf()));
      ISOSCOPE_ASSERT_OK(pass->Add(scene.meshes.front()));
      base::Cancellation cancelled;
      cancelled.Cancel();
      EXPECT_THAT(pass->Finish(cancelled), StatusIs(absl::StatusCode::kCancelled, _));
    }
    EXPECT_EQ(Draw(renderer.get(), other, scene.layout, few), expected);
    // Another appearance, then the first again.
    EXPECT_NE(Draw(renderer.get(), other, scene.layout, few, {.ambient = 0.5F}), expected);
    EXPECT_EQ(Draw(renderer.get(), other, scene.layout, few), expected);
  }
}

// Pixels of the first batch are shaded when the second one comes.
TEST_P(RendererTest, EqualDepthsAreDecidedAlikeInAnyBatch) {
  const Scene scene = EmptyScene();
  const view::View view = MakeOrthographicView(scene, 32, 32, 4, {32, 32, 32});
  const auto [low_mesh, high_mesh] = MakeTiedTriangles(scene);
  const bool color_decides = OrderOf(scene.layout).ties == image::TieRule::kColor;
  const FrameImage expected = Draw(view, scene.layout, {color_decides ? high_mesh : low_mesh});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeWithBatches(GetParam(), 1));
  EXPECT_EQ(Draw(renderer.get(), view, scene.layout, {low_mesh, high_mesh}), expected);
  EXPECT_EQ(Draw(renderer.get(), view, scene.layout, {high_mesh, low_mesh}), expected);
}

TEST_P(RendererTest, DescriptionNamesTheBackEnd) {
  EXPECT_THAT(renderer_->description(),
              ::testing::StartsWith(GetParam() == RendererKind::kCpu ? "cpu: " : "egl: "));
}

// Normals of both back ends are those of the sphere.
TEST_P(RendererTest, NormalsTravelInPlaceOfColors) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 0);
  const view::View view = MakeView(scene, 300, 240, 25, 15);
  frame::FrameSpec spec = SpecOf();
  spec.sends_normals = true;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass, renderer_->BeginPass(view, scene.layout, spec));
  for (const MeshPtr& mesh : scene.meshes) {
    ISOSCOPE_ASSERT_OK(pass->Add(mesh));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameImage image, pass->Finish(base::Cancellation()));
  const FrameImage colors = Draw(view, scene.layout, scene.meshes);
  EXPECT_EQ(image.covered, colors.covered);
  const view::Unprojection unprojection(view);
  const math::Vec3d center = scene.geometry.Bounds().Center();
  int compared_count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t i = PixelIndex(image, x, y);
      ASSERT_EQ(image::DepthOf(image.keys[i]), image::DepthOf(colors.keys[i]));
      if (image::OwnerOf(image.keys[i]) == kNoOwner) {
        ASSERT_EQ(image.colors[i], Rgba8());
        continue;
      }
      const math::Vec3d p =
          unprojection.PositionOf(x, y, unprojection.DistanceOf(image::DepthOf(image.keys[i])));
      const std::array<float, 3> normal = image::DecodeNormal(image.colors[i]);
      const math::Vec3d n{static_cast<double>(normal[0]), static_cast<double>(normal[1]),
                          static_cast<double>(normal[2])};
      const double cosine = math::Dot(math::Normalized(p - center), n);
      ASSERT_GT(std::abs(cosine), 0.995) << x << ", " << y;
      ++compared_count;
    }
  }
  EXPECT_GT(compared_count, 5000);
}

INSTANTIATE_TEST_SUITE_P(BackEnds, RendererTest,
                         ::testing::Values(RendererKind::kEgl, RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == RendererKind::kEgl ? "Egl" : "Cpu";
                         });

TEST(CpuRendererTest, EveryInstructionSetDrawsTheSamePicture) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const auto renderer = MakeCpuRenderer(CpuRendererOptions{});
  std::vector<view::View> views{MakeView(scene, 333, 250, 20, 30),
                                MakeOrthographicView(scene, 200, 201, 20, {32, 40, 50}),
                                MakeOrthographicView(scene, 77, 900, 3, {32, 32, 58})};
  // From inside: triangles are cut at the near plane.
  view::Camera camera;
  camera.eye = {32, 32, 50};
  camera.target = {40, 20, 0};
  camera.fov_y_radians = 1.5;
  views.push_back(view::View::Make(camera, {160, 120}, scene.geometry).value());
  for (const view::View& view : views) {
    std::vector<FrameImage> images;
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                    renderer->BeginPass(view, scene.layout, SpecOf()));
      for (const MeshPtr& mesh : scene.meshes) {
        ISOSCOPE_ASSERT_OK(pass->Add(mesh));
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(images.emplace_back(), pass->Finish(base::Cancellation()));
      EXPECT_EQ(images.back(), images.front()) << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
    EXPECT_GT(CoveredCount(images.front()), 1000);
  }
}

// Add inside of a parallel loop must not wait for one of its own, and shading holds no lock: a
// thread that waits may take another Add, or another pass.
TEST(CpuRendererTest, PassesThatFillUpInOneArenaEndWithTheirPictures) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View view = MakeView(scene, 200, 200, 10, 10);
  const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(8);
  const auto unbounded = MakeCpuRenderer(CpuRendererOptions{.arena = arena});
  const auto bounded = MakeCpuRenderer(CpuRendererOptions{.max_kept_bytes = 20000, .arena = arena});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole,
                                unbounded->BeginPass(view, scene.layout, SpecOf()));
  EXPECT_EQ(AddAll(scene.meshes, whole.get()), 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameImage expected, whole->Finish(base::Cancellation()));
  constexpr int kFrames = 4;
  std::vector<FrameImage> images(kFrames);
  std::atomic<int> full_count{0};
  std::vector<std::thread> frames;
  for (FrameImage& image : images) {
    frames.emplace_back([&] {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                    bounded->BeginPass(view, scene.layout, SpecOf()));
      std::atomic<std::size_t> next{0};
      while (next.load() < scene.meshes.size()) {
        base::RunIn(arena.get(), [&] {
          tbb::parallel_for(0, 8, [&](int /*thread*/) {
            while (!pass->is_full()) {
              const std::size_t i = next.fetch_add(1);
              if (i >= scene.meshes.size()) {
                return;
              }
              EXPECT_THAT(pass->Add(scene.meshes[i]), IsOk());
            }
          });
        });
        full_count += pass->is_full() ? 1 : 0;
        EXPECT_THAT(pass->Shade(base::Cancellation()), IsOk());
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(image, pass->Finish(base::Cancellation()));
    });
  }
  for (std::thread& frame : frames) {
    frame.join();
  }
  EXPECT_GT(full_count, kFrames);
  for (const FrameImage& image : images) {
    EXPECT_EQ(image, expected);
  }
}

// Pictures are the same whatever the limit: only is_full tells that it holds.
TEST(CpuRendererTest, APassIsFullOnceItKeepsMoreBytesThanItsLimit) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View view = MakeView(scene, 200, 200, 10, 10);
  constexpr std::size_t kLimit = 20000;
  const auto renderer = MakeCpuRenderer(kLimit);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass, renderer->BeginPass(view, scene.layout, SpecOf()));
  std::size_t kept = 0;
  int full_count = 0;
  for (const MeshPtr& mesh : scene.meshes) {
    ISOSCOPE_ASSERT_OK(pass->Add(mesh));
    kept += mesh->size_bytes();
    ASSERT_LT(mesh->size_bytes(), kLimit);
    if (kept > kLimit) {
      ASSERT_TRUE(pass->is_full()) << kept;
    }
    if (pass->is_full()) {
      EXPECT_GT(kept, kLimit / 2) << "ties are counted, too, but are few";
      ISOSCOPE_ASSERT_OK(pass->Shade(base::Cancellation()));
      kept = 0;
      ++full_count;
    }
  }
  EXPECT_GT(full_count, 2);
}

TEST(CpuRendererTest, TiesCountForTheLimitOfWhatAPassKeeps) {
  const Scene scene = EmptyScene();
  const auto [low_mesh, high_mesh] = MakeTiedTriangles(scene);
  const view::View view = MakeOrthographicView(scene, 400, 400, 4, {32, 32, 32});
  const std::size_t meshes = low_mesh->size_bytes() + high_mesh->size_bytes();
  const auto renderer = MakeCpuRenderer(meshes + 1000);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass, renderer->BeginPass(view, scene.layout, SpecOf()));
  ISOSCOPE_ASSERT_OK(pass->Add(low_mesh));
  EXPECT_FALSE(pass->is_full());
  ISOSCOPE_ASSERT_OK(pass->Add(high_mesh));
  EXPECT_TRUE(pass->is_full()) << "thousands of pixels have two fragments of one depth";
}

TEST(CpuRendererTest, RunningOutOfTriangleNumbersDoesNotShow) {
  const Scene scene = MakeBumpySphere(48, 8, 18, 1);
  const view::View view = MakeView(scene, 200, 200, 10, 10);
  std::vector<FrameImage> images;
  for (const std::uint64_t numbers : {std::uint64_t{1} << 31, std::uint64_t{1000}}) {
    const auto renderer = MakeCpuRenderer(CpuRendererOptions{.max_kept_primitives = numbers});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                  renderer->BeginPass(view, scene.layout, SpecOf()));
    EXPECT_EQ(AddAll(scene.meshes, pass.get()) > 0, numbers == 1000);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(images.emplace_back(), pass->Finish(base::Cancellation()));
  }
  EXPECT_EQ(images[0], images[1]);
}

// The two back ends agree, except for rounding at edges of triangles: sub-pixel grids and
// interpolation differ.
TEST(RendererAgreementTest, CpuAndEglDrawTheSamePictureWithinRounding) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto egl, MakeRenderer({.kind = RendererKind::kEgl}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cpu, MakeRenderer({.kind = RendererKind::kCpu}));
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  for (const double azimuth : {0.0, 35.0, 160.0}) {
    const view::View view = MakeView(scene, 400, 300, azimuth, 20);
    std::vector<FrameImage> images;
    for (Renderer* renderer : {egl.get(), cpu.get()}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pass,
                                    renderer->BeginPass(view, scene.layout, SpecOf()));
      for (const MeshPtr& mesh : scene.meshes) {
        ISOSCOPE_ASSERT_OK(pass->Add(mesh));
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(images.emplace_back(), pass->Finish(base::Cancellation()));
    }
    std::int64_t covered_by_one = 0;
    std::int64_t visibly_different = 0;
    for (std::size_t i = 0; i < images[0].pixel_count(); ++i) {
      covered_by_one += (image::OwnerOf(images[0].keys[i]) == kNoOwner) !=
                                (image::OwnerOf(images[1].keys[i]) == kNoOwner)
                            ? 1
                            : 0;
      const Rgba8& a = images[0].colors[i];
      const Rgba8& b = images[1].colors[i];
      visibly_different += std::abs(a.g - b.g) > 8 ? 1 : 0;
    }
    const std::int64_t covered = CoveredCount(images[0]);
    EXPECT_GT(covered, 5000);
    // The silhouette is about 600 pixels long; a few of them may go either way.
    EXPECT_LE(covered_by_one, 12) << azimuth;
    EXPECT_LE(visibly_different, covered / 200) << azimuth;
  }
}

}  // namespace
}  // namespace isoscope::render
