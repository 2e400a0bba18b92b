// The extractor is compared with a slow reference, and checked by properties of surfaces:
//
// - Reference: all sample types and block sizes, bit for bit, on every instruction set.
// - Topology: watertight meshes, Euler characteristic, area and volume of a sphere, winding and
//   normals.
// - Special samples: ties, NaN, infinities, huge and tiny values.
// - Memory: no read outside the block, at any address.

#include "core/extract/block_extractor.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

// As in block_kernels.cc, so that all of its targets are tested.
#define HWY_WANT_AVX3_DL
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/volume/field_gradient.h"
#include "core/volume/scalar_span.h"
#include "hwy/targets.h"
#include "tests/support/block_cutter.h"
#include "tests/support/mesh_metrics.h"
#include "tests/support/reference_extractor.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

using math::Index3;
using math::Vec3d;
using math::Vec3f;
using mesh::BlockMesh;
using testing::MeshMetrics;
using volume::BlockLayout;
using volume::GridGeometry;
using volume::ScalarType;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

constexpr std::array<ScalarType, 8> kAllTypes{
    ScalarType::kUint8,  ScalarType::kInt8,  ScalarType::kUint16,  ScalarType::kInt16,
    ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64};

struct Volume {
  GridGeometry geometry;
  ScalarType type = ScalarType::kUint8;
  std::string bytes;
};

Volume MakeVolume(const Index3& dims, ScalarType type, std::string bytes) {
  Volume volume{{}, type, std::move(bytes)};
  volume.geometry.sample_dims = dims;
  return volume;
}

// Spacings that differ and a turned, sheared-free frame.
void UseObliqueFrame(GridGeometry* geometry) {
  geometry->spacing = {0.5, 1.25, 3};
  geometry->origin = {-7, 11, 0.25};
  geometry->direction = {{Vec3d{0.6, 0.8, 0}, Vec3d{-0.8, 0.6, 0}, Vec3d{0, 0, 1}}};
}

BlockLayout MakeLayout(const GridGeometry& geometry, const Index3& block_cells) {
  return BlockLayout::Make(geometry.sample_dims, block_cells).value();
}

std::vector<BlockMesh> ExtractBlocks(const Volume& volume, const Index3& block_cells,
                                     double isovalue) {
  return testing::ExtractAllBlocks(volume.geometry, MakeLayout(volume.geometry, block_cells),
                                   volume.type, volume.bytes, isovalue);
}

MeshMetrics MeasureBlocks(const Volume& volume, const Index3& block_cells, double isovalue) {
  const BlockLayout layout = MakeLayout(volume.geometry, block_cells);
  const std::vector<BlockMesh> blocks = ExtractBlocks(volume, block_cells, isovalue);
  return testing::Measure(testing::Weld(layout, blocks), volume.geometry);
}

std::array<std::uint32_t, 3> BitsOf(const Vec3f& v) {
  return {std::bit_cast<std::uint32_t>(v.x), std::bit_cast<std::uint32_t>(v.y),
          std::bit_cast<std::uint32_t>(v.z)};
}

// Triangles as edge keys, turned so that the smallest comes first.
std::multiset<std::array<std::int64_t, 3>> Canonical(
    const std::vector<std::array<std::int64_t, 3>>& triangles) {
  std::multiset<std::array<std::int64_t, 3>> canonical;
  for (std::array<std::int64_t, 3> t : triangles) {
    while (t[0] > t[1] || t[0] > t[2]) {
      t = {t[1], t[2], t[0]};
    }
    canonical.insert(t);
  }
  return canonical;
}

// Blocks against the reference: the same vertices bit for bit wherever they occur, the same
// triangles, the same number of crossed edges.
void ExpectEqualsReference(const Volume& volume, const Index3& block_cells, double isovalue) {
  SCOPED_TRACE(absl::StrCat(volume::NameOf(volume.type), ", isovalue ", isovalue, ", blocks of ",
                            block_cells.x, ",", block_cells.y, ",", block_cells.z));
  const testing::ReferenceSurface expected =
      testing::ReferenceExtractor(volume.geometry, volume.type, volume.bytes).Extract(isovalue);
  std::vector<std::array<std::int64_t, 3>> triangles;
  std::set<std::int64_t> keys;
  std::int64_t owned = 0;
  int mismatches = 0;
  for (const BlockMesh& block : ExtractBlocks(volume, block_cells, isovalue)) {
    owned += block.owned_vertex_count;
    ASSERT_EQ(block.positions.size(), block.normals.size());
    ASSERT_EQ(block.positions.size(), block.edge_keys.size());
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const auto entry = expected.vertices.find(block.edge_keys[i]);
      ASSERT_NE(entry, expected.vertices.end());
      keys.insert(block.edge_keys[i]);
      mismatches += BitsOf(entry->second.position) == BitsOf(block.positions[i]) ? 0 : 1;
      // -0 and 0 mean the same in a normal.
      mismatches += entry->second.normal == block.normals[i] ? 0 : 1;
    }
    for (std::size_t i = 0; i < block.indices.size(); i += 3) {
      triangles.push_back({block.edge_keys[block.indices[i]], block.edge_keys[block.indices[i + 1]],
                           block.edge_keys[block.indices[i + 2]]});
    }
  }
  EXPECT_EQ(mismatches, 0);
  EXPECT_EQ(keys.size(), expected.vertices.size());
  EXPECT_EQ(owned, expected.crossed_edge_count);
  EXPECT_EQ(Canonical(triangles), Canonical(expected.triangles));
}

constexpr std::array<Index3, 8> kBlockSizes{
    Index3{1, 1, 1},    Index3{2, 2, 2},    Index3{4, 4, 4},   Index3{8, 8, 8},
    Index3{16, 16, 16}, Index3{32, 32, 32}, Index3{5, 3, 128}, Index3{64, 7, 2}};

TEST(BlockExtractorTest, EqualsReferenceOnNoiseForEveryTypeAndBlockSize) {
  const Index3 dims{17, 12, 10};
  for (const ScalarType type : kAllTypes) {
    Volume volume = MakeVolume(dims, type, testing::SampleNoise(7, dims, type, 9));
    UseObliqueFrame(&volume.geometry);
    for (const Index3& block_cells : kBlockSizes) {
      ExpectEqualsReference(volume, block_cells, 5);
    }
  }
}

TEST(BlockExtractorTest, EqualsReferenceOnSmoothFieldAtManyIsovalues) {
  const Index3 dims{35, 20, 34};
  Volume volume = MakeVolume(
      dims, ScalarType::kInt16,
      testing::SampleField(testing::RandomField(3, 20, 6), dims, ScalarType::kInt16, 1000, -20));
  for (const double isovalue : {-1500.0, -20.0, 0.0, 333.3, 2000.0}) {
    ExpectEqualsReference(volume, {8, 8, 8}, isovalue);
    ExpectEqualsReference(volume, {32, 32, 32}, isovalue);
  }
}

TEST(BlockExtractorTest, EqualsReferenceInInteriorBlocksOfEveryType) {
  // 5 blocks on each axis: most have all their neighbours and take the unchecked path.
  const Index3 dims{21, 21, 21};
  for (const ScalarType type : kAllTypes) {
    const Volume volume =
        MakeVolume(dims, type, testing::SampleField(testing::GyroidField(2), dims, type, 40, 60));
    ExpectEqualsReference(volume, {4, 4, 4}, 60.5);
  }
}

TEST(BlockExtractorTest, EqualsReferenceAtExtremesOfIntegerTypes) {
  const Index3 dims{9, 9, 9};
  for (const ScalarType type : kAllTypes) {
    volume::VisitScalarType(type, [&]<typename T>() {
      std::string bytes;
      for (std::uint64_t i = 0; i < 729; ++i) {
        base::AppendLittleEndian(base::RandomBits(1, i) % 2 == 0 ? std::numeric_limits<T>::lowest()
                                                                 : std::numeric_limits<T>::max(),
                                 &bytes);
      }
      const Volume volume = MakeVolume(dims, type, std::move(bytes));
      for (const double isovalue : {0.0, static_cast<double>(std::numeric_limits<T>::max()),
                                    static_cast<double>(std::numeric_limits<T>::lowest()) / 2}) {
        ExpectEqualsReference(volume, {3, 3, 3}, isovalue);
      }
    });
  }
}

TEST(BlockExtractorTest, NothingOutsideTheRangeOfValues) {
  const Index3 dims{10, 10, 10};
  for (const ScalarType type : kAllTypes) {
    const Volume volume = MakeVolume(dims, type, testing::SampleNoise(5, dims, type, 100));
    for (const double isovalue : {-1e300, -1.0, 101.0, 1e300}) {
      for (const BlockMesh& block : ExtractBlocks(volume, {4, 4, 4}, isovalue)) {
        ADD_FAILURE() << "block " << block.block_id << " has a surface at " << isovalue;
      }
    }
  }
}

TEST(BlockExtractorTest, OldContentOfTheMeshIsReplaced) {
  const Index3 dims{9, 9, 9};
  const Volume volume = MakeVolume(
      dims, ScalarType::kUint8,
      testing::SampleField(testing::SphereField(0.7), dims, ScalarType::kUint8, 100, 100));
  const BlockLayout layout = MakeLayout(volume.geometry, {8, 8, 8});
  BlockExtractor extractor(volume.geometry, layout);
  BlockMesh mesh;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, 100, &mesh);
  ASSERT_GT(mesh.triangle_count(), 0);
  const BlockMesh first = mesh;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, 250, &mesh);
  EXPECT_TRUE(mesh.positions.empty() && mesh.normals.empty() && mesh.indices.empty() &&
              mesh.edge_keys.empty());
  EXPECT_EQ(mesh.owned_vertex_count, 0);
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, 100, &mesh);
  EXPECT_EQ(mesh.edge_keys, first.edge_keys);
  EXPECT_EQ(mesh.positions, first.positions);
  EXPECT_EQ(mesh.normals, first.normals);
  EXPECT_EQ(mesh.indices, first.indices);
}

TEST(BlockExtractorTest, WithAndWithoutEdgeKeysItIsTheSameMesh) {
  const Index3 dims{19, 14, 11};
  const Volume volume =
      MakeVolume(dims, ScalarType::kInt16, testing::SampleNoise(3, dims, ScalarType::kInt16, 100));
  const BlockLayout layout = MakeLayout(volume.geometry, {8, 8, 8});
  BlockExtractor extractor(volume.geometry, layout);
  BlockMesh mesh;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, volume.type, volume.bytes, id);
    extractor.ExtractWithEdgeKeys({id, volume.type, block.data()}, 50, &mesh);
    const mesh::BlockMeshView view = extractor.Extract({id, volume.type, block.data()}, 50);
    EXPECT_EQ(view.block_id, id);
    EXPECT_EQ(mesh.block_id, id);
    EXPECT_EQ(view.owned_vertex_count, mesh.owned_vertex_count);
    EXPECT_TRUE(std::ranges::equal(view.positions, mesh.positions));
    EXPECT_TRUE(std::ranges::equal(view.normals, mesh.normals));
    EXPECT_TRUE(std::ranges::equal(view.indices, mesh.indices));
    EXPECT_EQ(mesh.edge_keys.size(), mesh.positions.size());
  }
}

TEST(BlockExtractorTest, SamplesMayStartAtAnyAddress) {
  const Index3 dims{9, 9, 9};
  for (const ScalarType type : kAllTypes) {
    const Volume volume = MakeVolume(dims, type, testing::SampleNoise(5, dims, type, 100));
    const BlockLayout layout = MakeLayout(volume.geometry, {8, 8, 8});
    BlockExtractor extractor(volume.geometry, layout);
    BlockMesh aligned;
    extractor.ExtractWithEdgeKeys({0, type, volume.bytes.data()}, 50, &aligned);
    const std::string moved = "x" + volume.bytes;
    BlockMesh unaligned;
    extractor.ExtractWithEdgeKeys({0, type, moved.data() + 1}, 50, &unaligned);
    EXPECT_EQ(aligned.positions, unaligned.positions);
    EXPECT_EQ(aligned.indices, unaligned.indices);
  }
}

// Sound apart from the volume's border: every inner edge has two triangles, in opposite directions.
void ExpectSound(const MeshMetrics& metrics) {
  EXPECT_EQ(metrics.non_manifold_edge_count, 0);
  EXPECT_EQ(metrics.inconsistent_edge_count, 0);
}

TEST(BlockExtractorTest, NoiseIsWatertightWhenTheBorderIsOutside) {
  const Index3 dims{24, 20, 22};
  for (const double max_value : {3.0, 200.0}) {
    Volume volume = MakeVolume(dims, ScalarType::kUint8,
                               testing::SampleNoise(11, dims, ScalarType::kUint8, max_value));
    for (std::int64_t z = 0; z < dims.z; ++z) {
      for (std::int64_t y = 0; y < dims.y; ++y) {
        for (std::int64_t x = 0; x < dims.x; ++x) {
          if (x == 0 || y == 0 || z == 0 || x == dims.x - 1 || y == dims.y - 1 || z == dims.z - 1) {
            volume.bytes[static_cast<std::size_t>(x + dims.x * (y + dims.y * z))] = 0;
          }
        }
      }
    }
    const MeshMetrics whole = MeasureBlocks(volume, {128, 128, 128}, max_value / 2);
    for (const Index3& block_cells : kBlockSizes) {
      const MeshMetrics metrics = MeasureBlocks(volume, block_cells, max_value / 2);
      ExpectSound(metrics);
      EXPECT_GT(metrics.triangle_count, 1000);
      EXPECT_EQ(metrics.boundary_edge_count, 0);
      EXPECT_EQ(metrics.euler_characteristic(), whole.euler_characteristic());
      EXPECT_EQ(metrics.triangle_count, whole.triangle_count);
    }
  }
}

TEST(BlockExtractorTest, OpenEdgesLieOnTheVolumesBorderOnly) {
  const Index3 dims{20, 20, 20};
  const Volume volume =
      MakeVolume(dims, ScalarType::kUint8, testing::SampleNoise(2, dims, ScalarType::kUint8, 10));
  const BlockLayout layout = MakeLayout(volume.geometry, {4, 4, 4});
  const testing::WeldedMesh mesh = testing::Weld(layout, ExtractBlocks(volume, {4, 4, 4}, 5));
  ExpectSound(testing::Measure(mesh, volume.geometry));
  std::map<std::pair<std::int64_t, std::int64_t>, int> sides;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t from = mesh.triangles[i + k];
      const std::int64_t to = mesh.triangles[i + (k + 1) % 3];
      ++sides[{std::min(from, to), std::max(from, to)}];
    }
  }
  std::int64_t open = 0;
  for (const auto& [side, count] : sides) {
    if (count == 1) {
      ++open;
      const Vec3f& a = mesh.positions[static_cast<std::size_t>(side.first)];
      const Vec3f& b = mesh.positions[static_cast<std::size_t>(side.second)];
      bool on_border = false;
      for (int axis = 0; axis < 3; ++axis) {
        on_border |= a[axis] == b[axis] && (a[axis] == 0.0F || a[axis] == 19.0F);
      }
      EXPECT_TRUE(on_border);
    }
  }
  EXPECT_GT(open, 0);
}

MeshMetrics MeasureSphere(std::int64_t n) {
  const Index3 dims{n, n, n};
  Volume volume =
      MakeVolume(dims, ScalarType::kFloat64,
                 testing::SampleField(testing::SphereField(0.7), dims, ScalarType::kFloat64, 1, 0));
  const double spacing = 2.0 / static_cast<double>(n - 1);
  volume.geometry.spacing = {spacing, spacing, spacing};
  volume.geometry.origin = {-1, -1, -1};
  return MeasureBlocks(volume, {16, 16, 16}, 0);
}

TEST(BlockExtractorTest, SphereHasTheTopologyAreaAndVolumeOfASphere) {
  const double area = 4 * std::numbers::pi * 0.49;
  const double ball = 4.0 / 3 * std::numbers::pi * 0.343;
  const MeshMetrics coarse = MeasureSphere(33);
  const MeshMetrics fine = MeasureSphere(65);
  for (const MeshMetrics& metrics : {coarse, fine}) {
    ExpectSound(metrics);
    EXPECT_EQ(metrics.boundary_edge_count, 0);
    EXPECT_EQ(metrics.euler_characteristic(), 2);
  }
  EXPECT_NEAR(fine.area, area, 2e-3 * area);
  EXPECT_NEAR(fine.volume, ball, 2e-3 * ball);
  const double area_order = std::log2((area - coarse.area) / (area - fine.area));
  const double volume_order = std::log2((ball - coarse.volume) / (ball - fine.volume));
  EXPECT_NEAR(area_order, 2, 0.3);
  EXPECT_NEAR(volume_order, 2, 0.3);
}

TEST(BlockExtractorTest, TorusHasEulerCharacteristicZero) {
  const Index3 dims{50, 50, 30};
  const Volume volume = MakeVolume(
      dims, ScalarType::kFloat32,
      testing::SampleField(testing::TorusField(0.6, 0.25), dims, ScalarType::kFloat32, 1, 0));
  const MeshMetrics metrics = MeasureBlocks(volume, {8, 8, 8}, 0);
  ExpectSound(metrics);
  EXPECT_EQ(metrics.boundary_edge_count, 0);
  EXPECT_EQ(metrics.euler_characteristic(), 0);
}

TEST(BlockExtractorTest, NormalsAreUnitPointOutwardsAndAgreeWithTheWinding) {
  const Index3 dims{40, 40, 40};
  Volume volume =
      MakeVolume(dims, ScalarType::kFloat32,
                 testing::SampleField(testing::SphereField(0.7), dims, ScalarType::kFloat32, 1, 0));
  UseObliqueFrame(&volume.geometry);
  volume.geometry.spacing = {0.5, 0.5, 0.5};
  const math::Mat4d to_world = volume.geometry.world_from_index();
  const Vec3d center = math::TransformPoint(to_world, {19.5, 19.5, 19.5});
  const auto world = [&](const Vec3f& p) {
    return math::TransformPoint(
        to_world, {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)});
  };
  for (const BlockMesh& block : ExtractBlocks(volume, {8, 8, 8}, 0)) {
    for (std::size_t i = 0; i < block.indices.size(); i += 3) {
      std::array<Vec3d, 3> corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t index = block.indices[i + k];
        corners[k] = world(block.positions[index]);
        const Vec3f& n = block.normals[index];
        const Vec3d normal{static_cast<double>(n.x), static_cast<double>(n.y),
                           static_cast<double>(n.z)};
        EXPECT_NEAR(math::Length(normal), 1, 1e-6);
        EXPECT_GT(math::Dot(normal, math::Normalized(corners[k] - center)), 0.995);
      }
      const Vec3d face = math::Cross(corners[1] - corners[0], corners[2] - corners[0]);
      EXPECT_GE(math::Dot(face, corners[0] - center), 0);
    }
  }
}

TEST(BlockExtractorTest, GradientsOfALinearFieldAreExactUpToTheBorder) {
  const Index3 dims{12, 11, 10};
  std::string bytes;
  for (int z = 0; z < 10; ++z) {
    for (int y = 0; y < 11; ++y) {
      for (int x = 0; x < 12; ++x) {
        base::AppendLittleEndian(static_cast<std::int16_t>(2 * x + 3 * y - 6 * z), &bytes);
      }
    }
  }
  const Volume volume = MakeVolume(dims, ScalarType::kInt16, std::move(bytes));
  std::size_t vertices = 0;
  for (const BlockMesh& block : ExtractBlocks(volume, {4, 4, 4}, 0.5)) {
    for (const Vec3f& normal : block.normals) {
      EXPECT_FLOAT_EQ(normal.x, -2.0F / 7);
      EXPECT_FLOAT_EQ(normal.y, -3.0F / 7);
      EXPECT_FLOAT_EQ(normal.z, 6.0F / 7);
      ++vertices;
    }
  }
  EXPECT_GT(vertices, 100U);
}

Volume FloatVolume(const Index3& dims, std::vector<float> samples) {
  std::string bytes;
  for (const float sample : samples) {
    base::AppendLittleEndian(sample, &bytes);
  }
  return MakeVolume(dims, ScalarType::kFloat32, std::move(bytes));
}

TEST(BlockExtractorTest, TieIsInsideAndItsVertexLiesOnTheSample) {
  // One sample equal to the isovalue, below it all around.
  std::vector<float> samples(27, 0.0F);
  samples[13] = 1.0F;
  const Volume volume = FloatVolume({3, 3, 3}, samples);
  for (const Index3& block_cells : {Index3{1, 1, 1}, Index3{2, 2, 2}}) {
    for (const BlockMesh& block : ExtractBlocks(volume, block_cells, 1)) {
      for (const Vec3f& position : block.positions) {
        EXPECT_EQ(position, (Vec3f{1, 1, 1}));
      }
    }
    const MeshMetrics metrics = MeasureBlocks(volume, block_cells, 1);
    EXPECT_EQ(metrics.vertex_count, 6);
    EXPECT_EQ(metrics.triangle_count, 8);
    EXPECT_EQ(metrics.degenerate_triangle_count, 8);
    EXPECT_EQ(metrics.euler_characteristic(), 2);
  }
}

TEST(BlockExtractorTest, CellsThatTouchNanHaveNoTrianglesAndTheRestIsAsInTheReference) {
  const Index3 dims{21, 19, 17};
  std::string bytes =
      testing::SampleField(testing::GyroidField(1.5), dims, ScalarType::kFloat32, 1, 0);
  for (std::uint64_t i = 0; i < 60; ++i) {
    const std::size_t sample = base::RandomBits(9, i) % (bytes.size() / 4);
    base::StoreLittleEndian(kNan, bytes.data() + 4 * sample);
  }
  const Volume volume = MakeVolume(dims, ScalarType::kFloat32, std::move(bytes));
  for (const Index3& block_cells : kBlockSizes) {
    ExpectEqualsReference(volume, block_cells, 0.1);
  }
  for (const BlockMesh& block : ExtractBlocks(volume, {4, 4, 4}, 0.1)) {
    std::set<std::uint32_t> used(block.indices.begin(), block.indices.end());
    EXPECT_EQ(used.size(), block.positions.size()) << "vertices that no triangle uses";
  }
}

TEST(BlockExtractorTest, AllNanHasNoSurface) {
  const Volume volume = FloatVolume({5, 5, 5}, std::vector<float>(125, kNan));
  EXPECT_TRUE(ExtractBlocks(volume, {2, 2, 2}, 0).empty());
}

TEST(BlockExtractorTest, InfinitiesGiveFiniteVerticesOnTheirEdges) {
  const Index3 dims{13, 13, 13};
  std::string bytes =
      testing::SampleField(testing::GyroidField(1.5), dims, ScalarType::kFloat32, 1, 0);
  for (std::uint64_t i = 0; i < 150; ++i) {
    const std::size_t sample = base::RandomBits(4, i) % (bytes.size() / 4);
    base::StoreLittleEndian(i % 2 == 0 ? kInf : -kInf, bytes.data() + 4 * sample);
  }
  const Volume volume = MakeVolume(dims, ScalarType::kFloat32, std::move(bytes));
  for (const Index3& block_cells : kBlockSizes) {
    ExpectEqualsReference(volume, block_cells, 0.1);
  }
  for (const BlockMesh& block : ExtractBlocks(volume, {4, 4, 4}, 0.1)) {
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      EXPECT_TRUE(math::IsFinite(block.positions[i]));
      EXPECT_TRUE(math::IsFinite(block.normals[i]));
    }
  }
}

TEST(BlockExtractorTest, VertexNextToAnInfinityLiesAtTheFiniteSample) {
  const Volume volume = FloatVolume({2, 2, 2}, {0.0F, kInf, 0.0F, kInf, 0.0F, -kInf, -kInf, kInf});
  for (const BlockMesh& block : ExtractBlocks(volume, {1, 1, 1}, 1)) {
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const std::int64_t key = block.edge_keys[i];
      if (key == 0) {
        EXPECT_EQ(block.positions[i], (Vec3f{0, 0, 0}));  // from 0 to inf
      } else if (key == 3 * 6) {
        EXPECT_EQ(block.positions[i], (Vec3f{0.5F, 1, 1}));  // from -inf to inf
      }
    }
  }
}

TEST(BlockExtractorTest, HugeDoublesDoNotOverflow) {
  constexpr double kMax = std::numeric_limits<double>::max();
  std::string bytes;
  for (const double sample : {-kMax, kMax, -kMax, kMax, -kMax, kMax, -kMax, kMax}) {
    base::AppendLittleEndian(sample, &bytes);
  }
  const Volume volume = MakeVolume({2, 2, 2}, ScalarType::kFloat64, std::move(bytes));
  const std::vector<BlockMesh> blocks = ExtractBlocks(volume, {1, 1, 1}, kMax / 2);
  ASSERT_EQ(blocks.size(), 1U);
  ASSERT_EQ(blocks[0].positions.size(), 4U);
  for (const Vec3f& position : blocks[0].positions) {
    EXPECT_EQ(position.x, 0.75F);
  }
}

TEST(BlockExtractorTest, TinyValuesKeepTheirNormals) {
  const Index3 dims{8, 8, 8};
  const Volume volume = MakeVolume(
      dims, ScalarType::kFloat64,
      testing::SampleField(testing::SphereField(0.7), dims, ScalarType::kFloat64, 1e-200, 0));
  std::size_t vertices = 0;
  for (const BlockMesh& block : ExtractBlocks(volume, {8, 8, 8}, 0)) {
    for (const Vec3f& normal : block.normals) {
      EXPECT_NEAR(static_cast<double>(math::Length(normal)), 1, 1e-6);
      ++vertices;
    }
  }
  EXPECT_GT(vertices, 0U);
}

TEST(BlockExtractorTest, BlocksHaveTrianglesExactlyWhenTheirSpanIsActive) {
  const Index3 dims{17, 17, 17};
  const ScalarType type = ScalarType::kUint8;
  const Volume volume = MakeVolume(
      dims, type, testing::SampleField(testing::RandomField(8, 12, 3), dims, type, 30, 100));
  const BlockLayout layout = MakeLayout(volume.geometry, {2, 2, 2});
  for (const double isovalue : {80.0, 100.0, 100.5, 130.0}) {
    std::set<volume::BlockId> with_triangles;
    for (const BlockMesh& block : ExtractBlocks(volume, {2, 2, 2}, isovalue)) {
      if (block.triangle_count() > 0) {
        with_triangles.insert(block.block_id);
      }
    }
    for (std::int64_t i = 0; i < layout.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      const math::IndexBox own = layout.OwnSamplesOf(id);
      volume::ScalarSpan span;
      for (std::int64_t z = own.begin.z; z < own.end.z; ++z) {
        for (std::int64_t y = own.begin.y; y < own.end.y; ++y) {
          for (std::int64_t x = own.begin.x; x < own.end.x; ++x) {
            const double value = static_cast<std::uint8_t>(
                volume.bytes[static_cast<std::size_t>(x + dims.x * (y + dims.y * z))]);
            span.min = std::min(span.min, value);
            span.max = std::max(span.max, value);
          }
        }
      }
      EXPECT_EQ(volume::IsActive(span, isovalue), with_triangles.count(id) == 1) << "block " << id;
    }
  }
}

template <typename T>
void ExpectSameBytes(const std::vector<T>& expected, const std::vector<T>& actual,
                     const char* what) {
  ASSERT_EQ(expected.size(), actual.size()) << what;
  if (!expected.empty()) {
    EXPECT_EQ(std::memcmp(expected.data(), actual.data(), expected.size() * sizeof(T)), 0) << what;
  }
}

// Smooth sheets with noise on them, and for floats every kind of special sample in one corner.
Volume MixedVolume(const Index3& dims, ScalarType type) {
  Volume volume = MakeVolume(
      dims, type, testing::SampleField(testing::RandomField(5, 16, 8), dims, type, 30, 60));
  volume::VisitScalarType(type, [&]<typename T>() {
    const std::size_t count = volume.bytes.size() / sizeof(T);
    for (std::uint64_t i = 0; i < count / 20; ++i) {
      const std::size_t sample = base::RandomBits(12, i) % count;
      base::StoreLittleEndian(static_cast<T>(base::RandomBits(13, i) % 120),
                              volume.bytes.data() + sample * sizeof(T));
    }
    if constexpr (std::is_floating_point_v<T>) {
      const std::array<T, 6> special{std::numeric_limits<T>::quiet_NaN(),
                                     std::numeric_limits<T>::infinity(),
                                     -std::numeric_limits<T>::infinity(),
                                     // The reference doubles differences.
                                     static_cast<T>(sizeof(T) == 4 ? 3e38 : 1e300),
                                     std::numeric_limits<T>::denorm_min(), T{0} * T{-1}};
      for (std::uint64_t i = 0; i < 40; ++i) {
        const std::size_t sample = base::RandomBits(14, i) % (count / 4);
        base::StoreLittleEndian(special[i % special.size()],
                                volume.bytes.data() + sample * sizeof(T));
      }
    }
  });
  UseObliqueFrame(&volume.geometry);
  return volume;
}

TEST(BlockExtractorTest, EveryInstructionSetGivesTheSameBits) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_FALSE(targets.empty());
  std::vector<Volume> volumes;
  for (const ScalarType type : kAllTypes) {
    volumes.push_back(MixedVolume({41, 38, 36}, type));
    // Rows too long for the corners of a cell to come from two words.
    volumes.push_back(MixedVolume({90, 12, 11}, type));
  }
  for (const Volume& volume : volumes) {
    for (const Index3& block_cells : {Index3{8, 8, 8}, Index3{16, 16, 16}, Index3{88, 9, 5}}) {
      hwy::SetSupportedTargetsForTest(targets.back());
      const std::vector<BlockMesh> expected = ExtractBlocks(volume, block_cells, 60.25);
      ASSERT_FALSE(expected.empty());
      for (const std::int64_t target : targets) {
        SCOPED_TRACE(absl::StrCat(hwy::TargetName(target), " against ",
                                  hwy::TargetName(targets.back()), ", ",
                                  volume::NameOf(volume.type)));
        hwy::SetSupportedTargetsForTest(target);
        const std::vector<BlockMesh> actual = ExtractBlocks(volume, block_cells, 60.25);
        ASSERT_EQ(actual.size(), expected.size());
        for (std::size_t i = 0; i < actual.size(); ++i) {
          EXPECT_EQ(actual[i].block_id, expected[i].block_id);
          EXPECT_EQ(actual[i].owned_vertex_count, expected[i].owned_vertex_count);
          ExpectSameBytes(expected[i].positions, actual[i].positions, "positions");
          ExpectSameBytes(expected[i].normals, actual[i].normals, "normals");
          ExpectSameBytes(expected[i].indices, actual[i].indices, "indices");
          ExpectSameBytes(expected[i].edge_keys, actual[i].edge_keys, "edge_keys");
        }
      }
    }
  }
}

TEST(BlockExtractorTest, EveryInstructionSetEqualsTheReference) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    for (const ScalarType type : kAllTypes) {
      const Volume volume = MixedVolume({23, 22, 21}, type);
      ExpectEqualsReference(volume, {8, 8, 8}, 60.25);
      ExpectEqualsReference(volume, {3, 4, 5}, 60.25);
    }
  }
}

TEST(BlockExtractorTest, ReadsNothingOutsideTheBlock) {
  // Exactly the block's bytes on the heap, for AddressSanitizer; the smallest interior blocks have
  // the least room behind an interior sample.
  const Index3 dims{7, 7, 7};
  for (const ScalarType type : kAllTypes) {
    const Volume volume = MakeVolume(dims, type, testing::SampleNoise(5, dims, type, 100));
    for (const std::int64_t edge : {1, 2, 3, 4}) {
      const BlockLayout layout = MakeLayout(volume.geometry, {edge, edge, edge});
      BlockExtractor extractor(volume.geometry, layout);
      std::int64_t triangles = 0;
      for (std::int64_t i = 0; i < layout.block_count(); ++i) {
        const auto id = static_cast<volume::BlockId>(i);
        const std::string block = testing::CutBlock(layout, type, volume.bytes, id);
        const std::vector<char> exact(block.begin(), block.end());
        triangles += extractor.Extract({id, type, exact.data()}, 50).triangle_count();
      }
      EXPECT_GT(triangles, 0);
    }
  }
}

// Returns the magnitudes of all vertices, by position.
std::map<std::tuple<float, float, float>, float> MagnitudesOf(const Volume& volume,
                                                              const Index3& block_cells,
                                                              double isovalue) {
  const BlockLayout layout = MakeLayout(volume.geometry, block_cells);
  BlockExtractor extractor(volume.geometry, layout);
  std::map<std::tuple<float, float, float>, float> magnitudes;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, volume.type, volume.bytes, id);
    const volume::BlockSamples samples{id, volume.type, block.data()};
    const mesh::BlockMeshView plain = extractor.Extract(samples, isovalue);
    EXPECT_TRUE(plain.values.empty());
    const std::vector<Vec3f> normals(plain.normals.begin(), plain.normals.end());
    const mesh::BlockMeshView mesh = extractor.Extract(samples, isovalue, true);
    EXPECT_EQ(mesh.values.size(), mesh.positions.size());
    EXPECT_TRUE(
        std::equal(normals.begin(), normals.end(), mesh.normals.begin(), mesh.normals.end()));
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const Vec3f& p = mesh.positions[v];
      const auto [at, is_new] = magnitudes.insert({{p.x, p.y, p.z}, mesh.values.narrow()[v]});
      EXPECT_TRUE(is_new || at->second == mesh.values.narrow()[v])
          << "blocks differ in a vertex that they share";
    }
  }
  return magnitudes;
}

TEST(BlockExtractorTest, MagnitudesAreTheLengthsOfTheFieldsGradientsInAnyCut) {
  for (const ScalarType type : kAllTypes) {
    // A smooth field: two vertices at one place have the same gradient.
    Volume volume =
        MakeVolume({17, 14, 12}, type,
                   testing::SampleField(testing::GyroidField(2), {17, 14, 12}, type, 50, 60));
    UseObliqueFrame(&volume.geometry);
    const BlockLayout whole = MakeLayout(volume.geometry, {32, 32, 32});
    const std::string samples = testing::CutBlock(whole, type, volume.bytes, 0);
    const auto expected = MagnitudesOf(volume, {32, 32, 32}, 60.25);
    ASSERT_GT(expected.size(), 100U);
    for (const auto& [at, magnitude] : expected) {
      const auto [x, y, z] = at;
      const Vec3d gradient = volume::GradientAt(
          volume.geometry, whole, {0, type, samples.data()},
          {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)});
      const double length = math::Length(gradient);
      ASSERT_NEAR(static_cast<double>(magnitude), length, 1e-5 * (length + 1));
    }
    for (const std::int64_t edge : {5, 8}) {
      EXPECT_EQ(MagnitudesOf(volume, {edge, edge, edge}, 60.25), expected) << edge;
    }
  }
}

TEST(BlockExtractorTest, EveryInstructionSetGivesTheSameMagnitudes) {
  const absl::Cleanup reset = [] { hwy::SetSupportedTargetsForTest(0); };
  const Volume volume = MakeVolume({17, 14, 12}, ScalarType::kUint8,
                                   testing::SampleNoise(4, {17, 14, 12}, ScalarType::kUint8, 200));
  const std::int64_t supported = hwy::SupportedTargets();
  const BlockLayout layout = MakeLayout(volume.geometry, {8, 8, 8});
  std::vector<float> expected;
  for (std::int64_t rest = supported; rest != 0; rest &= rest - 1) {
    hwy::SetSupportedTargetsForTest(rest & -rest);
    BlockExtractor extractor(volume.geometry, layout);
    std::vector<float> magnitudes;
    for (std::int64_t i = 0; i < layout.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      const std::string block = testing::CutBlock(layout, volume.type, volume.bytes, id);
      const auto mesh = extractor.Extract({id, volume.type, block.data()}, 100, true);
      magnitudes.insert(magnitudes.end(), mesh.values.narrow().begin(), mesh.values.narrow().end());
    }
    if (expected.empty()) {
      expected = magnitudes;
    }
    EXPECT_EQ(magnitudes, expected) << hwy::TargetName(rest & -rest);
  }
  EXPECT_FALSE(expected.empty());
}

}  // namespace
}  // namespace isoscope::extract
