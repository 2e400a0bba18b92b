#include "core/render/cpu_rasterizer.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/unit/core/render/test_scenes.h"

namespace isoscope::render {
namespace {

Scene CubeScene() {
  return MakeIsosurface(65, 8, [](const math::Vec3d&) { return -1.0; });
}

view::Footprint WholeViewport(const view::View& view) {
  return {.rect = {0, 0, view.viewport().width_px, view.viewport().height_px}, .nearest_depth = 0};
}

struct Hit {
  float depth;
  std::uint32_t triangle;
};

// What each pixel got; a pixel that two tiles cover is a failure.
std::map<std::pair<int, int>, Hit> Rasterize(const mesh::BlockMesh& mesh, const view::View& view,
                                             const view::Footprint& footprint) {
  std::map<std::pair<int, int>, Hit> hits;
  std::set<std::pair<int, int>> seen;
  CpuRasterizer rasterizer;
  rasterizer.Rasterize(mesh, view, footprint, [&](const KeyTile& tile) {
    const std::uint64_t* key = tile.keys;
    for (int y = tile.rect.begin_y; y < tile.rect.end_y; ++y) {
      for (int x = tile.rect.begin_x; x < tile.rect.end_x; ++x, ++key) {
        EXPECT_TRUE(seen.insert({x, y}).second) << "tiles overlap at " << x << ", " << y;
        if (*key != KeyTile::kNoKey) {
          hits[{x, y}] = {std::bit_cast<float>(static_cast<std::uint32_t>(*key >> 32)),
                          static_cast<std::uint32_t>(*key)};
        }
      }
    }
  });
  return hits;
}

// Random triangles that tile a square: a grid of quads with jittered corners, each cut in two.
mesh::BlockMesh JitteredSheet(int quads, double jitter, float z, std::uint64_t seed) {
  mesh::BlockMesh mesh;
  const double step = 40.0 / quads;
  for (int y = 0; y <= quads; ++y) {
    for (int x = 0; x <= quads; ++x) {
      const bool is_border = x == 0 || y == 0 || x == quads || y == quads;
      const auto n = static_cast<std::uint64_t>(y * (quads + 1) + x);
      const double shift = is_border ? 0 : jitter * step;
      mesh.positions.push_back(
          {static_cast<float>(12 + step * x + shift * (base::RandomUnit(seed, 2 * n) - 0.5)),
           static_cast<float>(12 + step * y + shift * (base::RandomUnit(seed, 2 * n + 1) - 0.5)),
           z});
      mesh.normals.push_back({0, 0, 1});
    }
  }
  for (int y = 0; y < quads; ++y) {
    for (int x = 0; x < quads; ++x) {
      const auto a = static_cast<std::uint32_t>(y * (quads + 1) + x);
      const std::uint32_t b = a + 1;
      const std::uint32_t c = a + static_cast<std::uint32_t>(quads) + 1;
      const std::uint32_t d = c + 1;
      mesh.indices.insert(mesh.indices.end(), {a, b, d, a, d, c});
    }
  }
  return mesh;
}

TEST(CpuRasterizerTest, NeighboursNeitherShareNorMissAPixel) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 200, 200, 64, {32, 32, 32});
  for (const int quads : {1, 3, 17, 90, 300}) {
    const mesh::BlockMesh sheet = JitteredSheet(quads, 0.8, 32, 5);
    // Each triangle alone: no pixel may belong to two.
    std::map<std::pair<int, int>, int> times_covered;
    const auto together = Rasterize(sheet, view, WholeViewport(view));
    if (quads <= 17) {
      mesh::BlockMesh one = sheet;
      for (std::size_t i = 0; i < sheet.indices.size(); i += 3) {
        one.indices = {sheet.indices[i], sheet.indices[i + 1], sheet.indices[i + 2]};
        for (const auto& [pixel, hit] : Rasterize(one, view, WholeViewport(view))) {
          ++times_covered[pixel];
        }
      }
      for (const auto& [pixel, count] : times_covered) {
        EXPECT_EQ(count, 1) << quads << " quads, pixel " << pixel.first << ", " << pixel.second;
      }
    }
    // 40 of 64 samples are 125 of 200 pixels.
    EXPECT_EQ(together.size(), 125u * 125u) << quads << " quads";
  }
}

TEST(CpuRasterizerTest, DepthIsThePlaneUnderThePixelCentre) {
  const Scene scene = CubeScene();
  const view::View view = MakeView(scene, 160, 120, 20, 30);
  mesh::BlockMesh mesh;
  mesh.positions = {{5, 5, 10}, {60, 8, 30}, {20, 60, 50}};
  mesh.normals.assign(3, {0, 0, 1});
  mesh.indices = {0, 1, 2};
  const auto hits = Rasterize(mesh, view, WholeViewport(view));
  ASSERT_GT(hits.size(), 500u);
  for (const auto& [pixel, hit] : hits) {
    const std::array<double, 3> weights =
        BarycentricsAtPixel(mesh, 0, view, pixel.first, pixel.second);
    math::Vec3d p;
    for (std::size_t i = 0; i < 3; ++i) {
      const math::Vec3f& v = mesh.positions[i];
      p = p + math::Vec3d{static_cast<double>(v.x), static_cast<double>(v.y),
                          static_cast<double>(v.z)} *
                  weights[i];
    }
    const math::Vec4d clip = view.clip_from_index() * math::Vec4d{p.x, p.y, p.z, 1};
    // The point under the weights projects to the pixel centre, up to the sub-pixel snapping of the
    // corners, and its depth is the fragment's.
    EXPECT_NEAR((clip.x / clip.w * 0.5 + 0.5) * 160, pixel.first + 0.5, 0.01);
    EXPECT_NEAR((0.5 - clip.y / clip.w * 0.5) * 120, pixel.second + 0.5, 0.01);
    EXPECT_NEAR(static_cast<double>(hit.depth), clip.z / clip.w * 0.5 + 0.5, 1e-4);
  }
}

TEST(CpuRasterizerTest, TrianglesThroughTheNearPlaneAndFarOffScreenCoverWhatTheirPlaneCovers) {
  const Scene scene = CubeScene();
  // The eye inside the volume, and a floor that reaches behind it and far to the sides.
  view::Camera camera;
  camera.eye = {32, 40, 32};
  camera.target = {32, 40, 0};
  camera.fov_y_radians = 1.2;
  const auto view = view::View::Make(camera, {120, 120}, scene.geometry);
  ASSERT_TRUE(view.ok());
  mesh::BlockMesh mesh;
  mesh.positions = {{-4e6F, 32, 4e6F}, {4e6F, 32, 4e6F}, {32, 32, -4e6F}};
  mesh.normals.assign(3, {0, 1, 0});
  mesh.indices = {0, 1, 2};
  const auto hits = Rasterize(mesh, *view, WholeViewport(*view));
  // The floor is all below the horizon: rows 60 and on see it where it is behind the near plane.
  std::int64_t below_horizon = 0;
  for (const auto& [pixel, hit] : hits) {
    EXPECT_GE(pixel.second, 60);
    below_horizon += pixel.second >= 62 ? 1 : 0;
  }
  EXPECT_EQ(below_horizon, 120 * (120 - 62));
}

TEST(CpuRasterizerTest, FragmentsOutsideTheFootprintAreDroppedAndDepthIsClampedToIt) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 100, 100, 64, {32, 32, 32});
  const mesh::BlockMesh sheet = JitteredSheet(9, 0.5, 50, 1);
  const view::Footprint footprint{.rect = {40, 45, 60, 50}, .nearest_depth = 0.9F};
  const auto hits = Rasterize(sheet, view, footprint);
  EXPECT_EQ(hits.size(), 20u * 5u);
  for (const auto& [pixel, hit] : hits) {
    EXPECT_GE(pixel.first, 40);
    EXPECT_LT(pixel.first, 60);
    EXPECT_GE(pixel.second, 45);
    EXPECT_LT(pixel.second, 50);
    EXPECT_EQ(hit.depth, 0.9F);
  }
}

TEST(CpuRasterizerTest, EqualDepthsGoToTheFirstTriangle) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 50, 50, 64, {32, 32, 32});
  mesh::BlockMesh mesh = JitteredSheet(1, 0, 32, 1);
  const std::vector<std::uint32_t> indices = mesh.indices;
  mesh.indices.insert(mesh.indices.end(), indices.begin(), indices.end());
  for (const auto& [pixel, hit] : Rasterize(mesh, view, WholeViewport(view))) {
    EXPECT_LT(hit.triangle, 2u);
  }
}

TEST(CpuRasterizerTest, DegenerateTrianglesCoverNothing) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 50, 50, 64, {32, 32, 32});
  mesh::BlockMesh mesh;
  mesh.positions = {{10, 10, 32}, {50, 50, 32}, {30, 30, 32}, {10, 10, 32}};
  mesh.normals.assign(4, {0, 0, 1});
  mesh.indices = {0, 1, 2, 0, 3, 1, 0, 0, 0};
  EXPECT_TRUE(Rasterize(mesh, view, WholeViewport(view)).empty());
}

TEST(BarycentricsAtPixelTest, WeightsAreOneAtCornersAndStayInsideForSlivers) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  mesh::BlockMesh mesh;
  // Pixel (x, y) has its centre at index (x + 0.5, 63.5 - y).
  mesh.positions = {{10.5F, 13.5F, 32}, {40.5F, 13.5F, 32}, {10.5F, 43.5F, 32}};
  mesh.normals.assign(3, {0, 0, 1});
  mesh.indices = {0, 1, 2};
  EXPECT_NEAR(BarycentricsAtPixel(mesh, 0, view, 10, 50)[0], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(mesh, 0, view, 40, 50)[1], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(mesh, 0, view, 10, 20)[2], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(mesh, 0, view, 20, 40)[0], 1.0 / 3, 1e-6);
  mesh.positions = {{10, 10, 32}, {50, 50, 32}, {30, 30, 32}};
  const std::array<double, 3> weights = BarycentricsAtPixel(mesh, 0, view, 30, 33);
  double sum = 0;
  for (const double weight : weights) {
    EXPECT_GE(weight, 0);
    EXPECT_LE(weight, 1);
    sum += weight;
  }
  EXPECT_NEAR(sum, 1, 1e-12);
}

}  // namespace
}  // namespace isoscope::render
