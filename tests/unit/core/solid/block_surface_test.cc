#include "core/solid/block_surface.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/block_cutter.h"
#include "tests/support/mesh_metrics.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::solid {
namespace {

struct Scene {
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kFloat32;
  std::string samples;
  volume::InsideRule rule;
  SurfaceOptions options;
};

struct Surface {
  testing::WeldedMesh mesh;
  SurfaceSums sums;
};

Surface Extract(const Scene& scene, std::int64_t block_cells) {
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(scene.geometry.sample_dims, {block_cells, block_cells, block_cells})
          .value();
  BlockSurface extractor(scene.geometry, layout, std::make_shared<extract::BlockShapes>(layout),
                         scene.options);
  Surface surface;
  std::vector<mesh::BlockMesh> blocks;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, scene.type, scene.samples, id);
    extractor.Extract({id, scene.type, block.data()}, scene.rule, &blocks.emplace_back(),
                      &surface.sums);
  }
  surface.mesh = testing::Weld(layout, blocks);
  return surface;
}

using Place = std::array<float, 3>;

// The triangles by the positions of their corners, each turned to begin at the least.
std::vector<std::array<Place, 3>> SortedTriangles(const testing::WeldedMesh& mesh) {
  std::vector<std::array<Place, 3>> triangles;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    std::array<Place, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const math::Vec3f& p = mesh.positions[static_cast<std::size_t>(mesh.triangles[i + k])];
      corners[k] = {p.x, p.y, p.z};
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    triangles.push_back(corners);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

struct Faults {
  int open = 0;            // sides with no partner
  int doubled = 0;         // sides that two triangles have in one direction
  int split_vertices = 0;  // vertices whose triangles are not one fan
  int flat = 0;            // triangles with two corners of one place
  int unused = 0;          // vertices of no triangle
  int needles = 0;         // triangles without an area, their corners apart
};

Faults FaultsOf(const testing::WeldedMesh& mesh, const volume::GridGeometry& geometry) {
  Faults faults;
  const mesh::WorldPlacement placement(geometry);
  std::map<std::pair<std::int64_t, std::int64_t>, std::int64_t> sides;  // to the next corner
  std::vector<std::map<std::int64_t, std::int64_t>> links(mesh.positions.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t a = mesh.triangles[i + k];
      const std::int64_t b = mesh.triangles[i + (k + 1) % 3];
      const std::int64_t c = mesh.triangles[i + (k + 2) % 3];
      faults.doubled += sides.emplace(std::pair(a, b), c).second ? 0 : 1;
      links[static_cast<std::size_t>(a)][b] = c;
      faults.flat += placement.PositionOf(mesh.positions[static_cast<std::size_t>(a)]) ==
                             placement.PositionOf(mesh.positions[static_cast<std::size_t>(b)])
                         ? 1
                         : 0;
    }
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    std::array<math::Vec3d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = placement.PositionOf(mesh.positions[static_cast<std::size_t>(mesh.triangles[i + k])]);
    }
    faults.needles += math::Length(math::Cross(p[1] - p[0], p[2] - p[0])) == 0 ? 1 : 0;
  }
  for (const auto& [side, next] : sides) {
    faults.open += sides.count({side.second, side.first}) == 0 ? 1 : 0;
  }
  for (const auto& link : links) {
    faults.unused += link.empty() ? 1 : 0;
    if (link.empty()) {
      continue;
    }
    // From an end, if the fan is open.
    std::int64_t start = link.begin()->first;
    for (const auto& [from, to] : link) {
      if (std::none_of(link.begin(), link.end(),
                       [&](const auto& other) { return other.second == from; })) {
        start = from;
      }
    }
    std::size_t count = 0;
    for (std::int64_t at = start; link.count(at) != 0 && count <= link.size(); ++count) {
      at = link.at(at);
      if (at == start) {
        ++count;
        break;
      }
    }
    faults.split_vertices += count == link.size() ? 0 : 1;
  }
  return faults;
}

Scene NoiseScene(std::uint64_t seed, const math::Index3& dims, double levels) {
  Scene scene;
  scene.geometry.sample_dims = dims;
  std::vector<float> values;
  for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
    values.push_back(static_cast<float>(
        std::floor(base::RandomUnit(seed, static_cast<std::uint64_t>(i)) * levels)));
  }
  scene.samples.assign(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  return scene;
}

// has_holes: whether NaN may leave a vertex with several fans
void CheckManifold(const Scene& scene, bool is_closed, const std::string& what,
                   bool has_holes = false) {
  const Surface surface = Extract(scene, 4);
  const Faults faults = FaultsOf(surface.mesh, scene.geometry);
  EXPECT_EQ(faults.doubled, 0) << what;
  if (!has_holes) {
    EXPECT_EQ(faults.split_vertices, 0) << what;
  }
  EXPECT_EQ(faults.flat, 0) << what;
  EXPECT_EQ(faults.unused, 0) << what;
  EXPECT_EQ(faults.needles, 0) << what;
  EXPECT_EQ(faults.open, surface.sums.open_side_count) << what;
  if (is_closed) {
    EXPECT_EQ(faults.open, 0) << what;
  }
  for (const std::int64_t cells : {3, 7, 128}) {
    const Surface other = Extract(scene, cells);
    EXPECT_EQ(SortedTriangles(other.mesh), SortedTriangles(surface.mesh)) << what << " " << cells;
    EXPECT_EQ(other.mesh.positions.size(), surface.mesh.positions.size()) << what << " " << cells;
    EXPECT_EQ(other.sums.area.Value(), surface.sums.area.Value()) << what << " " << cells;
    EXPECT_EQ(other.sums.volume.Value(), surface.sums.volume.Value()) << what << " " << cells;
    EXPECT_EQ(other.sums.triangle_count, surface.sums.triangle_count) << what << " " << cells;
    EXPECT_EQ(other.sums.open_side_count, surface.sums.open_side_count) << what << " " << cells;
  }
}

// Random masks at an isovalue that is a sample: the surface touches itself everywhere.
TEST(BlockSurfaceTest, SurfacesThroughSamplesAreManifolds) {
  for (std::uint64_t seed = 0; seed < 9; ++seed) {
    Scene scene = NoiseScene(seed, {9, 8, 10}, seed % 3 == 0 ? 2 : 4);
    scene.rule = volume::InsideRule::OfIsovalue(1 + static_cast<double>(seed % 3));
    if (seed % 3 == 0) {
      scene.rule.isovalue = 1;
    }
    CheckManifold(scene, false, "seed " + std::to_string(seed));
    scene.options.closes = true;
    CheckManifold(scene, true, "closed, seed " + std::to_string(seed));
  }
}

// Noise with NaN, cut by planes and boxes that lie on samples, beside them, and across.
view::ClipRegion RandomRegion(std::uint64_t seed, const volume::GridGeometry& geometry) {
  std::uint64_t counter = 1000 * seed;
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * base::RandomUnit(77, counter++);
  };
  const math::Vec3d center = geometry.Bounds().Center();
  const math::Mat4d to_world = geometry.world_from_index();
  view::ClipRegion region;
  for (std::uint64_t i = 0; i < seed % 3; ++i) {
    math::Vec3d normal{uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
    if (seed % 4 == 1) {
      normal = {};
      normal[static_cast<int>(i)] = 1;
    }
    const math::Vec3d at = math::TransformPoint(
        to_world,
        {std::floor(uniform(2, 7)), std::floor(uniform(2, 7)), std::floor(uniform(2, 7))});
    region.half_spaces.push_back({normal, math::Dot(normal, seed % 5 == 4 ? center : at)});
  }
  if (seed % 2 == 0) {
    region.box = math::Box3d();
    region.box->Add(math::TransformPoint(to_world, {1, uniform(0, 3), std::floor(uniform(0, 3))}));
    region.box->Add(math::TransformPoint(to_world, {uniform(5, 9), 6, 6}));
  }
  return region;
}

TEST(BlockSurfaceTest, CutAndClosedSurfacesAreManifolds) {
  for (std::uint64_t seed = 0; seed < 28; ++seed) {
    Scene scene = NoiseScene(seed, {9, 8, 10}, seed % 2 == 0 ? 3 : 1000);
    auto* const values = reinterpret_cast<float*>(scene.samples.data());
    for (std::size_t i = 0; i < scene.samples.size() / sizeof(float); ++i) {
      if (seed % 3 == 1 && base::RandomUnit(seed + 100, i) < 0.03) {
        values[i] = std::numeric_limits<float>::quiet_NaN();
      }
    }
    if (seed % 7 > 3) {
      scene.geometry.spacing = {0.01, 0.01, 0.02};
      scene.geometry.origin = {500000, 4600000, -3};
    }
    if (seed % 5 == 2) {
      scene.geometry.direction = {{math::Vec3d{0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0, -1}}};
    }
    scene.rule = seed % 4 == 3 ? volume::InsideRule::OfLabels({1, 17})
                               : volume::InsideRule::OfIsovalue(seed % 2 == 0 ? 1 : 500);
    scene.options.clip = RandomRegion(seed, scene.geometry);
    CheckManifold(scene, false, "seed " + std::to_string(seed), seed % 3 == 1);
    scene.options.closes = true;
    CheckManifold(scene, true, "closed, seed " + std::to_string(seed));
  }
}

Scene FieldScene(const testing::Field& field, const math::Index3& dims) {
  Scene scene;
  scene.geometry.sample_dims = dims;
  for (int axis = 0; axis < 3; ++axis) {
    scene.geometry.spacing[axis] = 2.0 / static_cast<double>(dims[axis] - 1);
    scene.geometry.origin[axis] = -1;
  }
  scene.samples = testing::SampleField(field, dims, scene.type, 1, 0);
  scene.rule = volume::InsideRule::OfIsovalue(0);
  return scene;
}

view::HalfSpace HalfSpaceOf(const math::Vec3d& normal, double offset) { return {normal, offset}; }

constexpr double kPi = std::numbers::pi;

// A field that is linear in each cell: its surface is the octahedron, but for the float32 of t.
TEST(BlockSurfaceTest, AnOctahedronHasItsExactMeasures) {
  const auto octahedron = [](const math::Vec3d& p) {
    return 0.71 - std::abs(p.x) - std::abs(p.y) - std::abs(p.z);
  };
  for (const std::int64_t samples : {21, 41}) {
    const Surface surface = Extract(FieldScene(octahedron, {samples, samples, samples}), 16);
    EXPECT_EQ(surface.sums.open_side_count, 0);
    EXPECT_NEAR(surface.sums.volume.Value(), 4.0 / 3 * 0.71 * 0.71 * 0.71, 1e-6);
    EXPECT_NEAR(surface.sums.area.Value(), 4 * std::sqrt(3.0) * 0.71 * 0.71, 1e-6);
  }
}

struct Measures {
  double volume = 0;
  double area = 0;
};

Measures MeasuresOf(const testing::Field& field, const math::Index3& dims) {
  const Surface surface = Extract(FieldScene(field, dims), 16);
  EXPECT_EQ(surface.sums.open_side_count, 0);
  return {surface.sums.volume.Value(), surface.sums.area.Value()};
}

// Chords of length h and linear interpolation along edges lose a share of (h / r)^2, where r is the
// least radius of curvature. With half of h it is a quarter, so (4 * fine - coarse) / 3 lacks this
// term. A quarter of the next one, of (h / r)^4, is left.
TEST(BlockSurfaceTest, AClosedSurfaceHasTheMeasuresOfItsSolid) {
  struct Case {
    testing::Field field;
    math::Index3 cells;
    double h_over_r = 0;
    Measures exact;
  };
  const Measures ball{.volume = 4 * kPi / 3 * 0.343, .area = 4 * kPi * 0.49};
  const Measures torus{.volume = 2 * kPi * kPi * 0.6 * 0.0625, .area = 4 * kPi * kPi * 0.6 * 0.25};
  for (const Case& solid : {Case{testing::SphereField(0.7), {40, 40, 40}, 0.05 / 0.7, ball},
                            Case{testing::SphereField(0.7), {60, 60, 60}, 2.0 / 60 / 0.7, ball},
                            Case{testing::TorusField(0.6, 0.25), {80, 80, 40}, 0.1, torus}}) {
    const math::Index3 one{1, 1, 1};
    const Measures coarse = MeasuresOf(solid.field, solid.cells + one);
    const Measures fine = MeasuresOf(solid.field, solid.cells * std::int64_t{2} + one);
    const double rest = std::pow(solid.h_over_r, 4) / 4;
    EXPECT_NEAR((4 * fine.volume - coarse.volume) / 3, solid.exact.volume,
                solid.exact.volume * rest);
    EXPECT_NEAR((4 * fine.area - coarse.area) / 3, solid.exact.area, solid.exact.area * rest);
    EXPECT_LT(coarse.volume, fine.volume) << "vertices lie inside";
    EXPECT_LT(fine.volume, solid.exact.volume);
  }
}

// The volume of a hollow is negative: its surface encloses what is outside. The limit is as above.
TEST(BlockSurfaceTest, AHollowHasANegativeVolumeUntilItsSolidIsClosed) {
  const testing::Field sphere = testing::SphereField(0.7);
  const auto around = [&](const math::Vec3d& p) { return -sphere(p); };
  Scene scene = FieldScene(around, {41, 41, 41});
  const double hollow = Extract(scene, 16).sums.volume.Value();
  const double ball = 4 * kPi / 3 * 0.343;
  EXPECT_NEAR((4 * MeasuresOf(around, {81, 81, 81}).volume - hollow) / 3, -ball,
              ball * std::pow(0.05 / 0.7, 4) / 4);
  scene.options.closes = true;
  const Surface closed = Extract(scene, 16);
  EXPECT_NEAR(closed.sums.volume.Value(), 8 + hollow, 1e-12);
  EXPECT_EQ(closed.sums.open_side_count, 0);
}

TEST(BlockSurfaceTest, AMirroredGridHasTheSameMeasures) {
  Scene scene = FieldScene(testing::SphereField(0.7), {41, 41, 41});
  const Surface plain = Extract(scene, 16);
  scene.geometry.direction = {{math::Vec3d{1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
  const Surface mirrored = Extract(scene, 16);
  EXPECT_NEAR(mirrored.sums.volume.Value(), plain.sums.volume.Value(), 1e-6);
  EXPECT_NEAR(mirrored.sums.area.Value(), plain.sums.area.Value(), 1e-6);
}

// A half, a quarter and an eighth of a sphere, with flat faces.
TEST(BlockSurfaceTest, CapsCloseWhatPlanesAndBoxesCut) {
  Scene scene = FieldScene(testing::SphereField(0.7), {61, 61, 61});
  const double whole_area = Extract(scene, 16).sums.area.Value();
  scene.options.clip.half_spaces = {HalfSpaceOf({0, 0, 2}, 0)};
  const Surface open = Extract(scene, 16);
  EXPECT_NEAR(open.sums.area.Value(), whole_area / 2, 1e-5);
  EXPECT_GT(open.sums.open_side_count, 100);
  EXPECT_EQ(FaultsOf(open.mesh, scene.geometry).open, open.sums.open_side_count);
  scene.options.closes = true;
  const Surface half = Extract(scene, 16);
  EXPECT_EQ(half.sums.open_side_count, 0);
  EXPECT_NEAR(half.sums.volume.Value(), 2 * kPi / 3 * 0.343, 0.001);
  EXPECT_NEAR(half.sums.area.Value(), 3 * kPi * 0.49, 0.01);
  scene.options.clip.half_spaces = {HalfSpaceOf({1, 1, 0}, 0), HalfSpaceOf({1, -1, 0}, 0)};
  const Surface quarter = Extract(scene, 16);
  EXPECT_NEAR(quarter.sums.volume.Value(), kPi / 3 * 0.343, 0.001);
  EXPECT_EQ(FaultsOf(quarter.mesh, scene.geometry).open, 0);
  scene.options.clip = {.half_spaces = {}, .box = math::Box3d()};
  scene.options.clip.box->Add({0, 0, 0});
  scene.options.clip.box->Add({3, 3, 3});
  const Surface eighth = Extract(scene, 16);
  EXPECT_NEAR(eighth.sums.volume.Value(), kPi / 6 * 0.343, 0.001);
  EXPECT_EQ(FaultsOf(eighth.mesh, scene.geometry).open, 0);
}

TEST(BlockSurfaceTest, TheNormalOfACapPointsOut) {
  Scene scene = FieldScene(testing::SphereField(0.7), {31, 31, 31});
  scene.options = {.clip = {.half_spaces = {HalfSpaceOf({0, 0, 2}, 0.02)}, .box = {}},
                   .closes = true};
  const Surface surface = Extract(scene, 16);
  int caps = 0;
  for (std::size_t i = 0; i < surface.mesh.positions.size(); ++i) {
    const math::Vec3f& p = surface.mesh.positions[i];
    const bool is_inside = std::hypot(double{p.x} - 15, double{p.y} - 15) < 9;
    if (is_inside && p.z < 15.2F) {
      EXPECT_EQ(surface.mesh.normals[i], (math::Vec3f{0, 0, -1}));
      ++caps;
    }
  }
  EXPECT_GT(caps, 100);
}

// Where everything is inside, the surface is the border of the volume: closing faces alone.
TEST(BlockSurfaceTest, ASolidWithoutASurfaceIsClosedAtTheBorderOfTheVolume) {
  Scene scene = NoiseScene(1, {5, 6, 7}, 4);
  scene.geometry.spacing = {2, 3, 0.5};
  scene.rule = volume::InsideRule::OfIsovalue(-1);
  EXPECT_TRUE(Extract(scene, 4).mesh.triangles.empty());
  scene.options.closes = true;
  const Surface box = Extract(scene, 4);
  EXPECT_EQ(box.sums.volume.Value(), 8 * 15 * 3);
  EXPECT_EQ(box.sums.area.Value(), 2 * (8 * 15 + 15 * 3 + 8 * 3));
  EXPECT_EQ(FaultsOf(box.mesh, scene.geometry).open, 0);
  scene.options.clip.box = math::Box3d();
  scene.options.clip.box->Add({1, 1, 1});
  scene.options.clip.box->Add({5, 7.5, 2});
  EXPECT_EQ(Extract(scene, 4).sums.volume.Value(), 4 * 6.5);
}

// The eight cells around a sample that is NaN are no part of the solid.
TEST(BlockSurfaceTest, ASolidEndsAtCellsThatTouchNan) {
  Scene scene = NoiseScene(1, {8, 8, 8}, 4);
  scene.rule = volume::InsideRule::OfIsovalue(-1);
  scene.options.closes = true;
  auto* const values = reinterpret_cast<float*>(scene.samples.data());
  values[3 + 8 * (3 + 8 * 4)] = std::numeric_limits<float>::quiet_NaN();
  const Surface surface = Extract(scene, 4);
  EXPECT_EQ(surface.sums.volume.Value(), 343 - 8);
  EXPECT_EQ(surface.sums.area.Value(), 6 * 49 + 6 * 4);
  EXPECT_EQ(FaultsOf(surface.mesh, scene.geometry).open, 0);
}

// Two labels that touch: each has a closed surface. Together they lack a wedge along the circle
// where they meet what is around them, of less than a quarter of a cell.
TEST(BlockSurfaceTest, LabelsThatTouchAreClosedEach) {
  Scene scene;
  scene.geometry.sample_dims = {24, 24, 24};
  scene.type = volume::ScalarType::kUint8;
  for (int z = 0; z < 24; ++z) {
    for (int y = 0; y < 24; ++y) {
      for (int x = 0; x < 24; ++x) {
        const bool is_ball = std::hypot(x - 12, y - 12, z - 12) < 8;
        scene.samples.push_back(static_cast<char>(is_ball ? (x < 12 ? 3 : 7) : 0));
      }
    }
  }
  const auto volume_of = [&](const std::vector<double>& labels) {
    scene.rule = volume::InsideRule::OfLabels(labels);
    const Surface surface = Extract(scene, 8);
    const Faults faults = FaultsOf(surface.mesh, scene.geometry);
    EXPECT_EQ(faults.open + faults.doubled + faults.split_vertices + faults.needles, 0);
    EXPECT_EQ(surface.sums.open_side_count, 0);
    return surface.sums.volume.Value();
  };
  const double both = volume_of({3, 7});
  EXPECT_GT(both, 1500);
  const double apart = volume_of({3}) + volume_of({7});
  EXPECT_LT(apart, both);
  EXPECT_GT(apart, both - 2 * kPi * 8 / 4);
}

// A box of n x m x k samples of one label reaches half a cell beyond them. Its edges are cut at 45
// degrees, which takes 1/8 of a cell for each cell of length, and of each of its corners, of
// (1/2)^3, a tetrahedron of 1/48 is left.
TEST(BlockSurfaceTest, BoxesOfLabelsHaveTheirExactVolumes) {
  Scene scene;
  scene.geometry.sample_dims = {12, 9, 9};
  scene.type = volume::ScalarType::kUint8;
  for (int z = 0; z < 9; ++z) {
    for (int y = 0; y < 9; ++y) {
      for (int x = 0; x < 12; ++x) {
        const bool is_box = x >= 2 && x < 10 && y >= 3 && y < 6 && z >= 2 && z < 7;
        scene.samples.push_back(static_cast<char>(is_box ? (x < 6 ? 3 : 7) : 0));
      }
    }
  }
  const auto volume_of = [&](const std::vector<double>& labels) {
    scene.rule = volume::InsideRule::OfLabels(labels);
    return Extract(scene, 4).sums.volume.Value();
  };
  const auto expected = [](int n, int m, int k) {
    return n * m * k - 4.0 * (n - 1 + m - 1 + k - 1) / 8 - 8 * (1.0 / 8 - 1.0 / 48);
  };
  EXPECT_NEAR(volume_of({3}), expected(4, 3, 5), 1e-12);
  EXPECT_NEAR(volume_of({7}), expected(4, 3, 5), 1e-12);
  EXPECT_NEAR(volume_of({3, 7}), expected(8, 3, 5), 1e-12);
}

// A ball of samples that are 1, at isovalue 1: triangles of marching cubes have no area around each
// sample that is inside.
// Their pieces are made of the middles of edges, and moved at the end.
TEST(BlockSurfaceTest, SmoothLabelsAreTheSameManifoldWithOtherPlaces) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    Scene scene = NoiseScene(seed, {9, 8, 10}, 3);
    auto* const values = reinterpret_cast<float*>(scene.samples.data());
    for (std::size_t i = 0; i < scene.samples.size() / sizeof(float); ++i) {
      if (seed % 3 == 1 && base::RandomUnit(seed + 100, i) < 0.03) {
        values[i] = std::numeric_limits<float>::quiet_NaN();
      }
    }
    if (seed % 4 == 2) {
      scene.geometry.spacing = {0.01, 0.01, 0.02};
      scene.geometry.origin = {500000, 4600000, -3};
    }
    for (const bool closes : {false, true}) {
      scene.options.closes = closes;
      scene.rule = volume::InsideRule::OfLabels({1});
      const Surface rough = Extract(scene, 4);
      scene.rule = volume::InsideRule::OfLabels({1}, /*smooths=*/true);
      CheckManifold(scene, closes, "seed " + std::to_string(seed), seed % 3 == 1);
      const Surface smooth = Extract(scene, 4);
      EXPECT_EQ(smooth.mesh.positions.size(), rough.mesh.positions.size());
      EXPECT_EQ(smooth.sums.triangle_count, rough.sums.triangle_count);
      EXPECT_EQ(smooth.sums.open_side_count, rough.sums.open_side_count);
      EXPECT_NE(SortedTriangles(smooth.mesh), SortedTriangles(rough.mesh));
    }
  }
}

TEST(BlockSurfaceTest, NoTriangleOfAMaskAtItsOwnValueIsFlat) {
  const math::Index3 dims{16, 16, 16};
  Scene scene =
      FieldScene([](const math::Vec3d& p) { return math::Length(p) < 0.6 ? 1 : 0; }, dims);
  scene.rule = volume::InsideRule::OfIsovalue(1);
  const Surface surface = Extract(scene, 8);
  const Faults faults = FaultsOf(surface.mesh, scene.geometry);
  EXPECT_EQ(faults.flat + faults.needles + faults.open + faults.doubled + faults.split_vertices, 0);
  EXPECT_LT(surface.mesh.positions.size(), 500U);
  scene.rule = volume::InsideRule::OfIsovalue(0.5);
  EXPECT_GT(Extract(scene, 8).sums.volume.Value(), surface.sums.volume.Value());
}

// Vertices near (500000, 4600000) whose distance is below a step of float32 there.
TEST(BlockSurfaceTest, NeighboursFarFromTheOriginStayApart) {
  Scene scene = FieldScene(testing::SphereField(0.7), {31, 31, 31});
  const Surface near = Extract(scene, 16);
  struct Case {
    double spacing = 0;
    math::Vec3d origin;
  };
  for (const Case& far : {Case{.spacing = 0.01, .origin = {500000, 4600000, 0}},
                          Case{.spacing = 1e-6, .origin = {1e3, 1e3, 1e3}},
                          Case{.spacing = 0.01, .origin = {-500000, -4600000, 12}}}) {
    scene.geometry.spacing = {far.spacing, far.spacing, far.spacing};
    scene.geometry.origin = far.origin;
    const Surface surface = Extract(scene, 16);
    EXPECT_EQ(surface.mesh.positions.size(), near.mesh.positions.size());
    EXPECT_EQ(surface.mesh.triangles.size(), near.mesh.triangles.size());
    EXPECT_EQ(FaultsOf(surface.mesh, scene.geometry).flat, 0);
    const double scale = far.spacing * 15;
    EXPECT_NEAR(surface.sums.volume.Value() / (scale * scale * scale), near.sums.volume.Value(),
                1e-4);
  }
}

// Nothing is cut, closed or near a sample: the mesh is that of the extractor, vertex by vertex.
TEST(BlockSurfaceTest, AnOrdinarySurfaceIsThatOfPictures) {
  const Scene scene = FieldScene(testing::SphereField(0.7001), {33, 33, 33});
  const volume::BlockLayout layout = volume::BlockLayout::Make({33, 33, 33}, {8, 8, 8}).value();
  BlockSurface surface(scene.geometry, layout, std::make_shared<extract::BlockShapes>(layout), {});
  extract::BlockExtractor extractor(scene.geometry, layout);
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, scene.type, scene.samples, id);
    mesh::BlockMesh own;
    surface.Extract({id, scene.type, block.data()}, scene.rule, &own, nullptr);
    mesh::BlockMesh drawn;
    extractor.ExtractWithEdgeKeys({id, scene.type, block.data()}, scene.rule, &drawn);
    EXPECT_EQ(own.positions, drawn.positions);
    EXPECT_EQ(own.normals, drawn.normals);
    EXPECT_EQ(own.indices, drawn.indices);
    EXPECT_EQ(own.block_id, id);
    EXPECT_TRUE(own.edge_keys.empty() && own.copies.empty());
  }
}

// Two cubes of samples that share one sample, or two. All vertices lie on samples that are inside.
//
// Two samples: in two cells a prism on half the square of the cell joins the cubes, of volume 1/2.
// Area: 4 whole sides of each cube, the tops and bottoms of the prisms (4 / 2), and what joins the
// cubes (2 sqrt 2).
//
// One sample: six of the cells around it have the four samples of a side of a cube inside, and one
// more next to the shared one. The rule of least crease takes the diagonal between the two of the
// four that lie beside the shared one (edges of like direction). So the cell has the tetrahedron
// between these, the shared sample and the one more: its volume is 1/6, and its free side has three
// edges of sqrt 2. Area: 3 whole sides of each cube, half of each of the others, six free sides.
TEST(BlockSurfaceTest, CubesThatShareSamplesAreOneSolid) {
  const auto scene_of = [](const math::Index3& second) {
    Scene scene = NoiseScene(0, {8, 8, 8}, 0);
    auto* const values = reinterpret_cast<float*>(scene.samples.data());
    for (const math::Index3& cube : {math::Index3{2, 2, 2}, second}) {
      for (int i = 0; i < 8; ++i) {
        const math::Index3 at{cube.x + i % 2, cube.y + i / 2 % 2, cube.z + i / 4};
        values[at.x + 8 * (at.y + 8 * at.z)] = 1;
      }
    }
    scene.rule = volume::InsideRule::OfIsovalue(1);
    return scene;
  };
  const Surface one = Extract(scene_of({2, 2, 2}), 4);
  EXPECT_EQ(one.mesh.positions.size(), 8U);
  EXPECT_EQ(one.mesh.triangles.size(), 36U);
  EXPECT_EQ(one.sums.volume.Value(), 1);
  EXPECT_EQ(one.sums.area.Value(), 6);
  struct Case {
    math::Index3 second;
    double volume = 0;
    double area = 0;
  };
  for (const Case& shared :
       {Case{.second = {3, 3, 2}, .volume = 2 + 2.0 / 2, .area = 8 + 2 + 2 * std::sqrt(2.0)},
        Case{.second = {3, 3, 3}, .volume = 2 + 6.0 / 6, .area = 6 + 3 + 3 * std::sqrt(3.0)}}) {
    const Scene scene = scene_of(shared.second);
    const Surface two = Extract(scene, 4);
    const Faults faults = FaultsOf(two.mesh, scene.geometry);
    EXPECT_EQ(faults.open + faults.doubled + faults.split_vertices, 0);
    EXPECT_EQ(two.sums.volume.Value(), shared.volume);
    EXPECT_NEAR(two.sums.area.Value(), shared.area, 1e-12);
  }
}

TEST(BlockSurfaceTest, OnlyBlocksWithSomethingInsideMayHaveASurface) {
  const math::Index3 dims{25, 9, 9};
  const volume::BlockLayout layout = volume::BlockLayout::Make(dims, {8, 4, 4}).value();
  const volume::BlockLayout thick = volume::BlockLayout::Make({33, 33, 33}, {8, 8, 8}).value();
  const volume::GridGeometry geometry{
      .sample_dims = dims, .spacing = {1, 1, 1}, .origin = {}, .direction = {}};
  const view::Clipper all({}, geometry);
  const auto may = [&](const volume::BlockLayout& of, std::int64_t block,
                       const volume::ScalarSpan& span, volume::ScalarType type,
                       const view::Clipper& clipper) {
    volume::RangeTable ranges(type, of.block_count());
    ranges.Set(static_cast<volume::BlockId>(block), span);
    volume::BlockSpans spans(ranges);
    return MayHaveSurface(of, static_cast<volume::BlockId>(block), &spans,
                          volume::InsideRule::OfIsovalue(5), clipper);
  };
  constexpr auto kUint8 = volume::ScalarType::kUint8;
  EXPECT_FALSE(may(layout, 0, {0, 4}, kUint8, all));  // nothing is inside
  EXPECT_TRUE(may(layout, 0, {5, 9}, kUint8, all));   // at the border
  EXPECT_TRUE(may(layout, 0, {4, 5}, kUint8, all));
  const std::int64_t middle = 1 + 4 * (1 + 4 * 1);
  EXPECT_FALSE(may(thick, middle, {5, 9}, kUint8, all));
  EXPECT_TRUE(may(thick, middle, {4, 9}, kUint8, all));
  EXPECT_TRUE(may(thick, middle, {5, 9}, volume::ScalarType::kFloat32, all));  // may have NaN
  const view::Clipper cut({.half_spaces = {HalfSpaceOf({1, 0, 0}, 12)}, .box = {}}, geometry);
  EXPECT_TRUE(may(thick, middle, {5, 9}, kUint8, cut));
  EXPECT_FALSE(may(thick, middle - 1, {4, 9}, kUint8, cut));
  EXPECT_FALSE(may(thick, middle + 1, {5, 9}, kUint8, cut));
}

}  // namespace
}  // namespace isoscope::solid
