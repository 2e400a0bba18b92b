#include "core/render/layer_pass.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <numbers>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/render/cpu_renderer.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/render/test_scenes.h"

namespace isoscope::render {
namespace {

// A bumpy sphere seen from the side: two layers almost everywhere, some of them of equal depth.
class LayerPassTest : public ::testing::Test {
 protected:
  LayerPassTest() {
    spec_.surfaces.resize(2);
    spec_.surfaces[1].appearance.base_color = {90, 200, 90, 255};
    for (frame::Surface& surface : spec_.surfaces) {
      surface.opacity = 0.5F;
    }
  }

  static std::vector<MeshToDraw> MeshesOf(const Scene& scene, std::uint32_t surface_index) {
    std::vector<MeshToDraw> meshes;
    for (const MeshPtr& mesh : scene.meshes) {
      meshes.push_back({.mesh = mesh, .surface_index = surface_index});
    }
    return meshes;
  }

  image::LayerStack DrawLayers(const view::View& view, const Scene& scene,
                               const std::vector<MeshToDraw>& meshes) {
    LayerPass pass(view, scene.layout, spec_, &renderer_);
    EXPECT_THAT(pass.Add(meshes), testing::IsOk());
    return pass.Finish();
  }

  // The opaque picture of the same meshes.
  image::FrameImage DrawOpaque(const view::View& view, const Scene& scene,
                               const std::vector<MeshToDraw>& meshes) {
    const std::unique_ptr<Renderer> renderer = MakeCpuRenderer(CpuRendererOptions());
    auto pass = renderer->BeginPass(view, scene.layout, spec_);
    EXPECT_THAT(pass, testing::IsOk());
    EXPECT_THAT((*pass)->Add(meshes), testing::IsOk());
    const base::Cancellation never;
    return *(*pass)->Finish(never);
  }

  frame::FrameSpec spec_;
  LayerRenderer renderer_{std::size_t{16} << 20};
};

TEST_F(LayerPassTest, TheFirstLayerIsTheOpaquePictureOfTheSameMeshes) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 310, 250, 25, 15);
  std::vector<MeshToDraw> meshes = MeshesOf(scene, 1);
  const std::vector<MeshToDraw> others = MeshesOf(scene, 0);
  meshes.insert(meshes.end(), others.begin(), others.end());
  for (const bool sends_normals : {false, true}) {
    spec_.sends_normals = sends_normals;
    const image::LayerStack layers = DrawLayers(view, scene, meshes);
    const std::vector<const image::FrameImage*> layer_images = layers.LayerImages();
    // Two surfaces in the same place, in front and at the back.
    ASSERT_GE(layer_images.size(), 4U);
    EXPECT_TRUE(*layer_images.front() == DrawOpaque(view, scene, meshes)) << sends_normals;
    for (std::size_t i = 0; i < layer_images.front()->pixel_count(); ++i) {
      if (layer_images[0]->keys[i] != image::kBackgroundKey) {
        ASSERT_TRUE(image::HaveEqualDepth(layer_images[0]->keys[i], layer_images[1]->keys[i]));
        ASSERT_EQ(layers.order().SurfaceOf(image::OwnerOf(layer_images[0]->keys[i])), 0U);
        ASSERT_EQ(layers.order().SurfaceOf(image::OwnerOf(layer_images[1]->keys[i])), 1U);
      }
    }
  }
}

TEST_F(LayerPassTest, ThreadsAndTheOrderOfMeshesDoNotShow) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 310, 250, 25, 15);
  const std::vector<MeshToDraw> meshes = MeshesOf(scene, 0);
  const image::LayerStack expected = DrawLayers(view, scene, meshes);
  EXPECT_GE(expected.LayerImages().size(), 2U);

  LayerPass pass(view, scene.layout, spec_, &renderer_);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t i = meshes.size(); i-- > 0;) {
        if (i % 4 == t) {
          EXPECT_THAT(pass.Add(std::span(&meshes[i], 1)), testing::IsOk());
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_TRUE(pass.Finish() == expected);
}

TEST_F(LayerPassTest, ClippedAndClosedFragmentsAreDropped) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View view = MakeView(scene, 200, 200, 25, 15);
  const std::vector<MeshToDraw> meshes = MeshesOf(scene, 0);
  const math::Vec3d normal{0.3, 1, 0.2};
  spec_.clip.half_spaces = {{normal, math::Dot(normal, math::Vec3d{31, 31, 31})}};
  const image::LayerStack clipped = DrawLayers(view, scene, meshes);
  EXPECT_TRUE(*clipped.LayerImages().front() == DrawOpaque(view, scene, meshes));

  image::PixelMask closed;  // of no pixel
  std::vector<MeshToDraw> masked = meshes;
  for (MeshToDraw& mesh : masked) {
    mesh.open = &closed;
  }
  EXPECT_TRUE(DrawLayers(view, scene, masked).empty());
}

TEST_F(LayerPassTest, ARegionHasTheLayersOfTheWhole) {
  const Scene scene = MakeBumpySphere(64, 8, 26, 1.5);
  const view::View whole = MakeView(scene, 200, 200, 25, 15);
  const view::Region region{61, 70, 77, 50};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const view::View part,
      view::View::Make(whole.camera(), whole.viewport(), scene.geometry, region));
  const std::vector<MeshToDraw> meshes = MeshesOf(scene, 0);
  const image::LayerStack whole_layers = DrawLayers(whole, scene, meshes);
  const image::LayerStack part_layers = DrawLayers(part, scene, meshes);
  for (std::size_t k = 0; k < 2; ++k) {
    const image::FrameImage& expected = *whole_layers.LayerImages()[k];
    const image::FrameImage& layer_image = *part_layers.LayerImages()[k];
    for (int y = 0; y < region.height_px; ++y) {
      for (int x = 0; x < region.width_px; ++x) {
        ASSERT_EQ(layer_image.keys[layer_image.IndexOf(x, y)],
                  expected.keys[expected.IndexOf(region.x + x, region.y + y)]);
        ASSERT_EQ(layer_image.colors[layer_image.IndexOf(x, y)],
                  expected.colors[expected.IndexOf(region.x + x, region.y + y)]);
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::render
