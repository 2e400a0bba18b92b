// Fragments are compared with definitions that are computed slowly, in doubles:
//
// - coverage: neighbours share and miss no pixel, for triangles of all sizes;
// - depth: the plane under the pixel's centre, clamped to the footprint;
// - clipping: at the near plane, far off screen, and by a clip region;
// - weights: at corners, in slivers, beside the triangle.

#include "core/render/cpu_rasterizer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/math/matrix.h"
#include "hwy/targets.h"
#include "tests/support/status_matchers.h"
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

// Returns the fragment of each pixel with the least depth, then the lowest triangle index.
std::map<std::pair<int, int>, Hit> Rasterize(const mesh::BlockMesh& mesh, const view::View& view,
                                             const view::Footprint& footprint,
                                             const image::PixelMask* open = nullptr) {
  std::map<std::pair<int, int>, std::pair<float, std::uint32_t>> nearest;
  CpuRasterizer rasterizer;
  rasterizer.Rasterize(
      *mesh::Compact(mesh), view, footprint, open, {}, [&](const FragmentBatch& batch) {
        for (std::size_t i = 0; i < batch.pixels.size(); ++i) {
          const int x = static_cast<int>(batch.pixels[i] & 0xffff);
          const int y = static_cast<int>(batch.pixels[i] >> 16);
          EXPECT_TRUE(x >= batch.bounds.begin_x && x < batch.bounds.end_x &&
                      y >= batch.bounds.begin_y && y < batch.bounds.end_y)
              << "a fragment out of its bounds at " << x << ", " << y;
          const std::pair hit{std::bit_cast<float>(batch.depths[i]), batch.triangles[i]};
          const auto [entry, is_new] = nearest.try_emplace({x, y}, hit);
          if (!is_new) {
            entry->second = std::min(entry->second, hit);
          }
        }
      });
  std::map<std::pair<int, int>, Hit> hits;
  for (const auto& [pixel, hit] : nearest) {
    hits[pixel] = {hit.first, hit.second};
  }
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
        BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, pixel.first, pixel.second);
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

// The fragments of a rasterizer, sorted: (pixel, triangle, depth bits).
using Fragments = std::vector<std::array<std::uint32_t, 3>>;
Fragments AllFragments(const mesh::BlockMesh& mesh, const view::View& view,
                       const view::Footprint& footprint, const image::PixelMask* open) {
  Fragments all;
  CpuRasterizer rasterizer;
  rasterizer.Rasterize(*mesh::Compact(mesh), view, footprint, open, {},
                       [&](const FragmentBatch& batch) {
                         for (std::size_t i = 0; i < batch.pixels.size(); ++i) {
                           all.push_back({batch.pixels[i], batch.triangles[i], batch.depths[i]});
                         }
                       });
  std::sort(all.begin(), all.end());
  return all;
}

// Triangles of about this size all over a ball in index space.
mesh::BlockMesh Confetti(int count, double size, double radius, std::uint64_t seed) {
  mesh::BlockMesh mesh;
  std::uint64_t n = 0;
  const auto random = [&]() { return base::RandomUnit(seed, n++) - 0.5; };
  for (int i = 0; i < count; ++i) {
    const math::Vec3d center{32 + 2 * radius * random(), 32 + 2 * radius * random(),
                             32 + 2 * radius * random()};
    for (int corner = 0; corner < 3; ++corner) {
      mesh.positions.push_back({static_cast<float>(center.x + 2 * size * random()),
                                static_cast<float>(center.y + 2 * size * random()),
                                static_cast<float>(center.z + 2 * size * random())});
      mesh.normals.push_back({0, 0, 1});
      mesh.indices.push_back(static_cast<std::uint32_t>(mesh.indices.size()));
    }
  }
  return mesh;
}

struct Sweep {
  double size;    // of a triangle, in cells
  double radius;  // of the mesh
};
constexpr std::array<Sweep, 7> kSweeps{
    {{0.1, 4}, {0.3, 4}, {1, 4}, {3, 4}, {12, 6}, {40, 20}, {400, 20}}};

// Which pixels a triangle covers, by the definition: the vertices snapped to 1/256 pixels, the
// centre inside all edges or on a top or left one. For triangles in front of the near plane.
std::set<std::uint32_t> CoveredByDefinition(const mesh::BlockMesh& mesh, std::uint32_t triangle,
                                            const view::View& view, const view::PixelRect& rect) {
  std::array<std::array<std::int64_t, 2>, 3> v;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3f& p = mesh.positions[mesh.indices[3 * std::size_t{triangle} + i]];
    const math::Vec4d clip =
        view.clip_from_index() * math::Vec4d{static_cast<double>(p.x), static_cast<double>(p.y),
                                             static_cast<double>(p.z), 1};
    v[i] = {std::llrint((clip.x / clip.w * 0.5 + 0.5) * view.viewport().width_px * 256),
            std::llrint((0.5 - clip.y / clip.w * 0.5) * view.viewport().height_px * 256)};
  }
  const auto cross = [](const auto& a, const auto& b, const auto& p) {
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
  };
  if (cross(v[0], v[1], v[2]) < 0) {
    std::swap(v[1], v[2]);
  }
  std::set<std::uint32_t> covered;
  if (cross(v[0], v[1], v[2]) == 0) {
    return covered;
  }
  for (int y = rect.begin_y; y < rect.end_y; ++y) {
    for (int x = rect.begin_x; x < rect.end_x; ++x) {
      const std::array<std::int64_t, 2> p{256 * x + 128, 256 * y + 128};
      bool is_inside = true;
      for (std::size_t i = 0; i < 3; ++i) {
        const auto& a = v[i];
        const auto& b = v[(i + 1) % 3];
        const std::int64_t side = cross(a, b, p);
        const bool is_top_left = b[1] < a[1] || (b[1] == a[1] && b[0] > a[0]);
        is_inside = is_inside && (side > 0 || (side == 0 && is_top_left));
      }
      if (is_inside) {
        covered.insert(static_cast<std::uint32_t>(x) | static_cast<std::uint32_t>(y) << 16);
      }
    }
  }
  return covered;
}

TEST(CpuRasterizerTest, TrianglesOfAllSizesCoverWhatTheDefinitionSays) {
  const Scene scene = CubeScene();
  // In the second picture most of the mesh is left of the first pixel or right of the last.
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{{150, 140}, {7, 300}}) {
    const view::View view = MakeView(scene, width, height, 20, 30);
    const view::Footprint whole = WholeViewport(view);
    for (const Sweep& sweep : kSweeps) {
      if (sweep.size > 30) {
        continue;  // some would be clipped
      }
      const mesh::BlockMesh mesh = Confetti(120, sweep.size, sweep.radius, 3);
      std::map<std::uint32_t, std::set<std::uint32_t>> covered;
      for (const auto& [pixel, triangle, depth] : AllFragments(mesh, view, whole, nullptr)) {
        EXPECT_TRUE(covered[triangle].insert(pixel).second) << "a pixel twice";
      }
      for (std::uint32_t triangle = 0; triangle < 120; ++triangle) {
        ASSERT_EQ(covered[triangle], CoveredByDefinition(mesh, triangle, view, whole.rect))
            << "size " << sweep.size << ", triangle " << triangle << ", width " << width;
      }
    }
  }
}

TEST(CpuRasterizerTest, FragmentsDoNotDependOnTheOtherTriangles) {
  const Scene scene = CubeScene();
  const view::View view = MakeView(scene, 150, 140, 20, 30);
  for (const Sweep& sweep : kSweeps) {
    const mesh::BlockMesh mesh = Confetti(150, sweep.size, sweep.radius, 4);
    Fragments expected;
    mesh::BlockMesh one = mesh;
    for (std::uint32_t triangle = 0; triangle < 150; ++triangle) {
      const auto* corners = &mesh.indices[3 * std::size_t{triangle}];
      one.indices.assign(corners, corners + 3);
      // The triangle alone, because other triangles must not matter.
      mesh::BlockMesh alone;
      for (const std::uint32_t vertex : one.indices) {
        alone.positions.push_back(mesh.positions[vertex]);
      }
      alone.normals.assign(3, {0, 0, 1});
      alone.indices = {0, 1, 2};
      for (auto [pixel, index, depth] : AllFragments(alone, view, WholeViewport(view), nullptr)) {
        expected.push_back({pixel, triangle, depth});
      }
    }
    std::sort(expected.begin(), expected.end());
    EXPECT_EQ(AllFragments(mesh, view, WholeViewport(view), nullptr), expected) << sweep.size;
  }
}

TEST(CpuRasterizerTest, EveryInstructionSetGivesTheSameBits) {
  const Scene scene = CubeScene();
  std::vector<view::View> views;
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{150, 140}, {1, 1}, {7, 300}, {1023, 31}}) {
    views.push_back(MakeView(scene, width, height, 20, 30));
    views.push_back(MakeOrthographicView(scene, width, height, 30, {32, 32, 32}));
  }
  // The eye inside: the near plane cuts through the triangles.
  view::Camera camera;
  camera.eye = {32, 32, 34};
  camera.target = {32, 32, 0};
  camera.fov_y_radians = 1.2;
  views.push_back(view::View::Make(camera, {200, 200}, scene.geometry).value());

  const image::PixelMask mask{.shift = 1,
                              .begin_column = 3,
                              .begin_row = 2,
                              .columns = 60,
                              .rows = 40,
                              .words = std::vector<std::uint64_t>(38, 0xf0f3355aa1234567u)};
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  for (const view::View& view : views) {
    for (const Sweep& sweep : kSweeps) {
      for (const int count : {1, 17, sweep.size < 10 ? 700 : 40}) {
        const mesh::BlockMesh mesh = Confetti(count, sweep.size, sweep.radius, 5);
        view::Footprint footprint = WholeViewport(view);
        footprint.nearest_depth = 0.3F;
        for (const image::PixelMask* open :
             {static_cast<const image::PixelMask*>(nullptr), &mask}) {
          std::vector<Fragments> results;
          for (const std::int64_t target : targets) {
            hwy::SetSupportedTargetsForTest(target);
            results.push_back(AllFragments(mesh, view, footprint, open));
            ASSERT_EQ(results.back(), results.front())
                << hwy::TargetName(target) << ", triangles of " << sweep.size;
          }
          hwy::SetSupportedTargetsForTest(0);
          if (open != nullptr) {
            Fragments expected = AllFragments(mesh, view, footprint, nullptr);
            std::erase_if(expected, [&](const auto& fragment) {
              return !mask.Contains(static_cast<int>(fragment[0] & 0xffff),
                                    static_cast<int>(fragment[0] >> 16));
            });
            ASSERT_EQ(results.front(), expected);
          }
        }
      }
    }
  }
}

// A clipped mesh has the fragments of the whole one that lie inside, with their depths.
TEST(CpuRasterizerTest, ClippingKeepsTheFragmentsInsideAsTheyAre) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  mesh::BlockMesh mesh;
  for (int i = 0; i < 12; ++i) {
    const auto shift = static_cast<float>(3 * i);
    mesh.positions.insert(mesh.positions.end(), {{4.2F + shift, 5, 10 + shift},
                                                 {20.7F + shift, 18.1F, 30},
                                                 {3.3F, 27.9F + shift, 12 + shift}});
    for (const std::uint32_t corner : {0U, 1U, 2U}) {
      mesh.indices.push_back(static_cast<std::uint32_t>(3 * i) + corner);
    }
  }
  mesh.normals.assign(mesh.positions.size(), {0, 0, 1});
  const auto compact = mesh::Compact(mesh);
  const view::Footprint footprint = WholeViewport(view);
  const std::vector<view::HalfSpace> half_spaces{{{1, 0.4, 0.2}, 26.1}, {{0, 0, -1}, -28.5}};
  const Fragments whole = AllFragments(mesh, view, footprint, nullptr);
  Fragments expected;
  for (const auto& fragment : whole) {
    const std::array<double, 3> weights =
        BarycentricsAtPixel(*compact, fragment[1], view, static_cast<int>(fragment[0] & 0xffff),
                            static_cast<int>(fragment[0] >> 16));
    math::Vec3d position;
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const math::Vec3f& p = mesh.positions[mesh.indices[3 * fragment[1] + corner]];
      position = position + math::Vec3d{static_cast<double>(p.x), static_cast<double>(p.y),
                                        static_cast<double>(p.z)} *
                                weights[corner];
    }
    if (math::Dot(half_spaces[0].normal, position) >= half_spaces[0].offset &&
        math::Dot(half_spaces[1].normal, position) >= half_spaces[1].offset) {
      expected.push_back(fragment);
    }
  }
  Fragments clipped;
  CpuRasterizer rasterizer;
  rasterizer.Rasterize(
      *compact, view, footprint, nullptr, half_spaces, [&](const FragmentBatch& batch) {
        for (std::size_t i = 0; i < batch.pixels.size(); ++i) {
          clipped.push_back({batch.pixels[i], batch.triangles[i], batch.depths[i]});
        }
      });
  std::sort(clipped.begin(), clipped.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(clipped, expected);
  EXPECT_GT(expected.size(), whole.size() / 10);
  EXPECT_LT(expected.size(), whole.size() * 9 / 10);
}

TEST(BarycentricsAtPixelTest, WeightsAreOneAtCornersAndStayInsideForSlivers) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  mesh::BlockMesh mesh;
  // Pixel (x, y) has its centre at index (x + 0.5, 63.5 - y).
  mesh.positions = {{10.5F, 13.5F, 32}, {40.5F, 13.5F, 32}, {10.5F, 43.5F, 32}};
  mesh.normals.assign(3, {0, 0, 1});
  mesh.indices = {0, 1, 2};
  EXPECT_NEAR(BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 10, 50)[0], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 40, 50)[1], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 10, 20)[2], 1, 1e-6);
  EXPECT_NEAR(BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 20, 40)[0], 1.0 / 3, 1e-6);
  mesh.positions = {{10, 10, 32}, {50, 50, 32}, {30, 30, 32}};
  const std::array<double, 3> weights = BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 30, 33);
  double sum = 0;
  for (const double weight : weights) {
    EXPECT_GE(weight, 0);
    EXPECT_LE(weight, 1);
    sum += weight;
  }
  EXPECT_NEAR(sum, 1, 1e-12);
}

TEST(BarycentricsNearPixelTest, BesideTheTriangleItIsTheNearestPointOnTheScreen) {
  const Scene scene = CubeScene();
  const view::View view = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32});
  mesh::BlockMesh mesh;
  // Pixel (x, y) has its centre at index (x + 0.5, 63.5 - y).
  mesh.positions = {{10.5F, 13.5F, 32}, {40.5F, 13.5F, 32}, {10.5F, 43.5F, 32}};
  mesh.normals.assign(3, {0, 0, 1});
  mesh.indices = {0, 1, 2};
  const auto weights_at = [&](int x, int y) {
    return BarycentricsNearPixel(*mesh::Compact(mesh), 0, view, x, y);
  };
  EXPECT_EQ(weights_at(20, 40), BarycentricsAtPixel(*mesh::Compact(mesh), 0, view, 20, 40));
  const std::array<double, 3> below = weights_at(25, 55);  // half-way along the first side
  EXPECT_NEAR(below[0], 0.5, 1e-6);
  EXPECT_NEAR(below[1], 0.5, 1e-6);
  EXPECT_EQ(below[2], 0);
  EXPECT_NEAR(weights_at(2, 60)[0], 1, 1e-6) << "a corner";
  // For a sliver it is the point nearest to the pixel; clamping would give a point far away.
  mesh.positions = {{10.5F, 13.5F, 30}, {40.5F, 13.5F, 30}, {25.5F, 13.499F, 36}};
  const std::array<double, 3> sliver = weights_at(15, 49);  // a pixel above it
  EXPECT_NEAR(10.5 * sliver[0] + 40.5 * sliver[1] + 25.5 * sliver[2], 15.5, 1e-3);
}

TEST(BarycentricsNearPixelTest, WithPerspectiveNoPointOfASideIsNearer) {
  const Scene scene = CubeScene();
  view::Camera camera = MakeOrthographicView(scene, 64, 64, 64, {32, 32, 32}).camera();
  camera.projection = view::Projection::kPerspective;
  camera.eye = camera.target + math::Normalized(camera.eye - camera.target) * 120.0;
  camera.fov_y_radians = 0.6;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                view::View::Make(camera, {64, 64}, scene.geometry));
  int outside_count = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    mesh::BlockMesh mesh;
    for (std::uint64_t i = 0; i < 3; ++i) {
      const auto coordinate = [&](std::uint64_t k) {
        return static_cast<float>(64 * base::RandomUnit(seed, 3 * i + k));
      };
      mesh.positions.push_back({coordinate(0), coordinate(1), coordinate(2)});
    }
    mesh.normals.assign(3, {0, 0, 1});
    mesh.indices = {0, 1, 2};
    const auto compact = mesh::Compact(mesh);
    const int x = static_cast<int>(64 * base::RandomUnit(seed, 20));
    const int y = static_cast<int>(64 * base::RandomUnit(seed, 21));
    // The distance on the screen between the pixel's centre and the point with some weights.
    const auto distance_of = [&](const std::array<double, 3>& weights) {
      math::Vec4d clip;
      for (std::size_t i = 0; i < 3; ++i) {
        const math::Vec3f& p = mesh.positions[i];
        const math::Vec4d corner =
            view.clip_from_index() * math::Vec4d{static_cast<double>(p.x), static_cast<double>(p.y),
                                                 static_cast<double>(p.z), 1};
        clip.x += weights[i] * corner.x;
        clip.y += weights[i] * corner.y;
        clip.w += weights[i] * corner.w;
      }
      return std::hypot((clip.x / clip.w + 1) * 32 - (x + 0.5),
                        (1 - clip.y / clip.w) * 32 - (y + 0.5));
    };
    const std::array<double, 3> nearest = BarycentricsNearPixel(*compact, 0, view, x, y);
    EXPECT_NEAR(nearest[0] + nearest[1] + nearest[2], 1, 1e-12);
    if (distance_of(nearest) < 1e-6) {
      EXPECT_EQ(nearest, BarycentricsAtPixel(*compact, 0, view, x, y));
      continue;
    }
    ++outside_count;
    for (std::size_t i = 0; i < 3; ++i) {
      for (double t = 0; t <= 1; t += 0.01) {
        std::array<double, 3> weights{};
        weights[i] = 1 - t;
        weights[(i + 1) % 3] = t;
        EXPECT_GE(distance_of(weights), distance_of(nearest) - 1e-9) << seed;
      }
    }
  }
  EXPECT_GT(outside_count, 150);
  EXPECT_LT(outside_count, 299);
}

}  // namespace
}  // namespace isoscope::render
