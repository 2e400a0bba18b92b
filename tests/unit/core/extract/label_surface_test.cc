// Surfaces of labels, through BlockExtractor:
//
// - Reference: a slow extraction of the whole volume that shares only the case table; all sample
//   types, block sizes and instruction sets, with NaN and without, bit for bit.
// - Topology: closed surfaces; two labels that meet have the same triangles, reversed.
// - Normals of a ball against the true ones.
// - Smooth surfaces: the same triangles, with vertices that follow from the whole volume.

#include "core/extract/label_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

// As in label_kernels.cc, so that all of its targets are tested.
#define HWY_WANT_AVX3_DL
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/extract/block_extractor.h"
#include "core/extract/label_case_table.h"
#include "core/extract/smooth_fraction.h"
#include "core/volume/inside_rule.h"
#include "hwy/targets.h"
#include "tests/support/block_cutter.h"
#include "tests/support/mesh_metrics.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

using math::Index3;
using math::Vec3d;
using math::Vec3f;
using mesh::BlockMesh;
using volume::InsideRule;
using volume::ScalarType;

using Triangle = std::array<std::int64_t, 3>;  // edge keys

constexpr std::array<ScalarType, 8> kAllTypes{
    ScalarType::kUint8,  ScalarType::kInt8,  ScalarType::kUint16,  ScalarType::kInt16,
    ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64};
constexpr std::array<Index3, 5> kBlockSizes{Index3{1, 1, 1}, Index3{4, 4, 4}, Index3{8, 8, 8},
                                            Index3{64, 64, 64}, Index3{5, 3, 70}};

struct Volume {
  volume::GridGeometry geometry;
  ScalarType type = ScalarType::kUint8;
  std::string bytes;
};

Volume MakeVolume(const Index3& dims, ScalarType type, std::string bytes) {
  Volume volume{{}, type, std::move(bytes)};
  volume.geometry.sample_dims = dims;
  volume.geometry.spacing = {0.5, 1.25, 3};
  volume.geometry.direction = {{Vec3d{0.6, 0.8, 0}, Vec3d{-0.8, 0.6, 0}, Vec3d{0, 0, 1}}};
  return volume;
}

// Whole numbers from 0 to count - 1.
Volume NoiseOfLabels(std::uint64_t seed, const Index3& dims, ScalarType type, int count) {
  std::string bytes;
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
      base::AppendLittleEndian(
          static_cast<T>(base::RandomBits(seed, static_cast<std::uint64_t>(i)) %
                         static_cast<std::uint64_t>(count)),
          &bytes);
    }
  });
  return MakeVolume(dims, type, std::move(bytes));
}

void SetSample(Volume* volume, std::int64_t index, double value) {
  volume::VisitScalarType(volume->type, [&]<typename T>() {
    base::StoreLittleEndian(static_cast<T>(value),
                            volume->bytes.data() + static_cast<std::size_t>(index) * sizeof(T));
  });
}

std::vector<BlockMesh> ExtractBlocks(const Volume& volume, const Index3& block_cells,
                                     const InsideRule& rule) {
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(volume.geometry.sample_dims, block_cells).value();
  BlockExtractor extractor(volume.geometry, layout);
  std::vector<BlockMesh> meshes(static_cast<std::size_t>(layout.block_count()));
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, volume.type, volume.bytes, id);
    extractor.ExtractWithEdgeKeys({id, volume.type, block.data()}, rule, &meshes[i]);
  }
  return meshes;
}

struct Vertex {
  Vec3f position;
  Vec3f normal;
};

struct Surface {
  std::map<std::int64_t, Vertex> vertices;  // by edge key
  std::multiset<Triangle> triangles;        // turned so that the smallest key comes first
  std::int64_t crossed_edge_count = 0;
};

Triangle Turned(Triangle t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

std::multiset<Triangle> Reversed(const std::multiset<Triangle>& triangles) {
  std::multiset<Triangle> reversed;
  for (const Triangle& t : triangles) {
    reversed.insert({t[0], t[2], t[1]});
  }
  return reversed;
}

// The slow extraction.
class Reference {
 public:
  Reference(const Volume& volume, const InsideRule& rule)
      : geometry_(volume.geometry), dims_(volume.geometry.sample_dims) {
    volume::VisitScalarType(volume.type, [&]<typename T>() {
      for (std::size_t i = 0; i < volume.bytes.size(); i += sizeof(T)) {
        const auto sample = static_cast<double>(base::LoadLittleEndian<T>(volume.bytes.data() + i));
        bool is_label = false;
        for (const double label : rule.labels) {
          is_label |= sample == label;
        }
        samples_.push_back(std::isnan(sample) ? -1 : is_label ? 1 : 0);
      }
    });
  }

  [[nodiscard]] Surface Extract() const {
    Surface surface;
    for (std::int64_t z = 0; z < dims_.z; ++z) {
      for (std::int64_t y = 0; y < dims_.y; ++y) {
        for (std::int64_t x = 0; x < dims_.x; ++x) {
          for (int axis = 0; axis < 3; ++axis) {
            Index3 upper{x, y, z};
            if (++upper[axis] < dims_[axis] && At({x, y, z}) >= 0 && At(upper) >= 0) {
              surface.crossed_edge_count += At({x, y, z}) != At(upper) ? 1 : 0;
            }
          }
          if (x + 1 < dims_.x && y + 1 < dims_.y && z + 1 < dims_.z) {
            AddCell({x, y, z}, &surface);
          }
        }
      }
    }
    return surface;
  }

 private:
  // 1 for a label, 0 for another number, -1 for NaN.
  [[nodiscard]] int At(const Index3& p) const {
    return samples_[static_cast<std::size_t>(p.x + dims_.x * (p.y + dims_.y * p.z))];
  }

  void AddCell(const Index3& cell, Surface* surface) const {
    std::size_t cell_case = 0;
    for (int c = 0; c < 8; ++c) {
      const int mark = At(cell + Index3{c & 1, c >> 1 & 1, c >> 2});
      if (mark < 0) {
        return;
      }
      cell_case |= static_cast<std::size_t>(mark) << c;
    }
    const LabelCaseTable& table = GetLabelCaseTable();
    for (std::size_t i = 0; i < table.TriangleCountOf(cell_case); ++i) {
      Triangle keys{};
      for (std::size_t k = 0; k < 3; ++k) {
        const int edge = table.EdgesOf(cell_case, i)[k];
        const int c = CornersOfEdge(edge).lower;
        const Index3 lower = cell + Index3{c & 1, c >> 1 & 1, c >> 2};
        keys[k] = 3 * (lower.x + dims_.x * (lower.y + dims_.y * lower.z)) + edge / 4;
        surface->vertices.try_emplace(keys[k], VertexOn(lower, edge / 4));
      }
      surface->triangles.insert(Turned(keys));
    }
  }

  [[nodiscard]] Vertex VertexOn(const Index3& lower, int axis) const {
    Index3 upper = lower;
    ++upper[axis];
    Vertex vertex{
        {static_cast<float>(lower.x), static_cast<float>(lower.y), static_cast<float>(lower.z)},
        {}};
    vertex.position[axis] += 0.5F;
    Vec3d gradient = SobelAt(lower) + SobelAt(upper);
    if (gradient == Vec3d{}) {
      gradient[axis] = At(upper) - At(lower);
    }
    const Vec3d world = -(geometry_.world_gradient_from_index() * gradient);
    const double largest = std::max({std::fabs(world.x), std::fabs(world.y), std::fabs(world.z)});
    const Vec3d unit = math::Normalized(world * (1 / largest));
    vertex.normal = {static_cast<float>(unit.x), static_cast<float>(unit.y),
                     static_cast<float>(unit.z)};
    return vertex;
  }

  [[nodiscard]] Vec3d SobelAt(const Index3& center) const {
    Vec3d sums;
    for (int k = 0; k < 27; ++k) {
      const std::array<int, 3> d{k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1};
      Index3 p = center;
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = std::clamp<std::int64_t>(p[axis] + d[static_cast<std::size_t>(axis)], 0,
                                           dims_[axis] - 1);
      }
      const int mark = At(p) < 0 ? At(center) : At(p);
      for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const int weight = (2 - std::abs(d[(a + 1) % 3])) * (2 - std::abs(d[(a + 2) % 3]));
        sums[axis] += d[a] * weight * mark;
      }
    }
    return sums;
  }

  const volume::GridGeometry geometry_;
  const Index3 dims_;
  std::vector<int> samples_;
};

// Joins blocks, and expects that they agree in the vertices that they share.
Surface Join(const std::vector<BlockMesh>& blocks) {
  Surface surface;
  for (const BlockMesh& block : blocks) {
    surface.crossed_edge_count += block.owned_vertex_count;
    EXPECT_EQ(block.positions.size(), block.edge_keys.size());
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const Vertex vertex{block.positions[i], block.normals[i]};
      const auto [at, is_new] = surface.vertices.try_emplace(block.edge_keys[i], vertex);
      EXPECT_TRUE(is_new ||
                  (at->second.position == vertex.position && at->second.normal == vertex.normal))
          << "blocks differ in a vertex that they share";
    }
    for (std::size_t i = 0; i < block.indices.size(); i += 3) {
      surface.triangles.insert(
          Turned({block.edge_keys[block.indices[i]], block.edge_keys[block.indices[i + 1]],
                  block.edge_keys[block.indices[i + 2]]}));
    }
  }
  return surface;
}

void ExpectEquals(const Surface& expected, const Volume& volume, const Index3& block_cells,
                  const InsideRule& rule) {
  SCOPED_TRACE(absl::StrCat(volume::NameOf(volume.type), ", ", rule.Text(), ", blocks of ",
                            block_cells.x, ",", block_cells.y, ",", block_cells.z));
  const Surface actual = Join(ExtractBlocks(volume, block_cells, rule));
  EXPECT_EQ(actual.crossed_edge_count, expected.crossed_edge_count);
  EXPECT_EQ(actual.triangles, expected.triangles);
  ASSERT_EQ(actual.vertices.size(), expected.vertices.size());
  int mismatches = 0;
  for (const auto& [key, vertex] : expected.vertices) {
    const auto found = actual.vertices.find(key);
    ASSERT_NE(found, actual.vertices.end());
    mismatches += found->second.position == vertex.position ? 0 : 1;
    mismatches += found->second.normal == vertex.normal ? 0 : 1;
  }
  EXPECT_EQ(mismatches, 0);
}

void ExpectEqualsReference(const Volume& volume, const Index3& block_cells,
                           const InsideRule& rule) {
  ExpectEquals(Reference(volume, rule).Extract(), volume, block_cells, rule);
}

TEST(LabelSurfaceTest, EqualsReferenceForEveryTypeAndBlockSize) {
  for (const ScalarType type : kAllTypes) {
    const Volume volume = NoiseOfLabels(7, {11, 9, 7}, type, 5);
    const InsideRule rule = InsideRule::OfLabels({3});
    const Surface expected = Reference(volume, rule).Extract();
    for (const Index3& block_cells : kBlockSizes) {
      ExpectEquals(expected, volume, block_cells, rule);
    }
    ExpectEqualsReference(volume, {4, 4, 4}, InsideRule::OfLabels({1, 2, 4}));
  }
}

TEST(LabelSurfaceTest, EveryInstructionSetEqualsTheReference) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  const InsideRule rule = InsideRule::OfLabels({0, 2});
  for (const ScalarType type : kAllTypes) {
    const Volume volume = NoiseOfLabels(5, {19, 9, 7}, type, 4);
    const Surface expected = Reference(volume, rule).Extract();
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      SCOPED_TRACE(hwy::TargetName(target));
      hwy::SetSupportedTargetsForTest(target);
      ExpectEquals(expected, volume, {8, 8, 8}, rule);
      ExpectEquals(expected, volume, {3, 4, 5}, rule);
    }
  }
}

TEST(LabelSurfaceTest, NanIsAHoleAndCountsAsTheCentreInNormals) {
  for (const ScalarType type : {ScalarType::kFloat32, ScalarType::kFloat64}) {
    Volume volume = NoiseOfLabels(9, {14, 13, 12}, type, 3);
    for (std::uint64_t i = 0; i < 60; ++i) {
      SetSample(&volume, static_cast<std::int64_t>(base::RandomBits(2, i) % (14 * 13 * 12)),
                std::numeric_limits<double>::quiet_NaN());
    }
    const InsideRule rule = InsideRule::OfLabels({1});
    const Surface expected = Reference(volume, rule).Extract();
    for (const Index3& block_cells : kBlockSizes) {
      ExpectEquals(expected, volume, block_cells, rule);
    }
  }
}

TEST(LabelSurfaceTest, InfinitiesAreOutside) {
  Volume volume = NoiseOfLabels(9, {9, 9, 9}, ScalarType::kFloat32, 3);
  for (std::int64_t i = 0; i < 729; i += 7) {
    SetSample(&volume, i, (i % 2 == 0 ? 1 : -1) * std::numeric_limits<double>::infinity());
  }
  ExpectEqualsReference(volume, {4, 4, 4}, InsideRule::OfLabels({1}));
}

TEST(LabelSurfaceTest, LabelsThatAreNoSampleHaveNoSurface) {
  for (const ScalarType type : kAllTypes) {
    const Volume volume = NoiseOfLabels(9, {6, 6, 6}, type, 3);
    for (const double label : {-1.0, 0.5, 300.5, 1e300}) {
      for (const BlockMesh& mesh :
           ExtractBlocks(volume, {4, 4, 4}, InsideRule::OfLabels({label}))) {
        EXPECT_TRUE(mesh.positions.empty() && mesh.indices.empty());
        EXPECT_EQ(mesh.owned_vertex_count, 0);
      }
    }
  }
}

// 3 to 5 labels; none of the rule's is at the volume's border.
TEST(LabelSurfaceTest, EveryLabelsSurfaceIsClosed) {
  const Index3 dims{16, 14, 15};
  for (const int count : {3, 4, 5}) {
    Volume volume =
        NoiseOfLabels(static_cast<std::uint64_t>(count), dims, ScalarType::kUint8, count);
    for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
      const Index3 p{i % dims.x, i / dims.x % dims.y, i / dims.x / dims.y};
      for (int axis = 0; axis < 3; ++axis) {
        if (p[axis] == 0 || p[axis] == dims[axis] - 1) {
          SetSample(&volume, i, 0);
        }
      }
    }
    for (const std::vector<double>& labels :
         {std::vector<double>{1}, std::vector<double>{2}, std::vector<double>{1, 2}}) {
      for (const Index3& block_cells : kBlockSizes) {
        const InsideRule rule = InsideRule::OfLabels(labels);
        const volume::BlockLayout layout = volume::BlockLayout::Make(dims, block_cells).value();
        const std::vector<BlockMesh> blocks = ExtractBlocks(volume, block_cells, rule);
        const testing::MeshMetrics metrics =
            testing::Measure(testing::Weld(layout, blocks), volume.geometry);
        EXPECT_GT(metrics.triangle_count, 500);
        EXPECT_EQ(metrics.boundary_edge_count, 0) << rule.Text();
        EXPECT_EQ(metrics.non_manifold_edge_count, 0) << rule.Text();
        EXPECT_EQ(metrics.inconsistent_edge_count, 0) << rule.Text();
      }
    }
  }
}

TEST(LabelSurfaceTest, TwoLabelsHaveOneSurfaceInOppositeDirectionsInAllCasesAndCuts) {
  // A row of cells for each case, each apart from the next: corners of cell k are samples 2k and
  // 2k + 1 on x. The cells between have other cases.
  const Index3 dims{512, 2, 2};
  Volume cases = NoiseOfLabels(1, dims, ScalarType::kUint8, 1);
  for (std::int64_t cell_case = 0; cell_case < 256; ++cell_case) {
    for (std::int64_t c = 0; c < 8; ++c) {
      SetSample(&cases, 2 * cell_case + (c & 1) + dims.x * ((c >> 1 & 1) + 2 * (c >> 2)),
                (cell_case >> c & 1) != 0 ? 9 : 4);
    }
  }
  Volume noise = NoiseOfLabels(8, {17, 16, 15}, ScalarType::kInt16, 2);
  for (std::int64_t i = 0; i < 17 * 16 * 15; ++i) {
    SetSample(&noise, i, base::RandomBits(8, static_cast<std::uint64_t>(i)) % 2 == 0 ? 4 : 9);
  }
  for (const Volume* volume : {&cases, &noise}) {
    for (const Index3& block_cells : kBlockSizes) {
      const Surface low = Join(ExtractBlocks(*volume, block_cells, InsideRule::OfLabels({4})));
      const Surface high = Join(ExtractBlocks(*volume, {6, 7, 8}, InsideRule::OfLabels({9})));
      EXPECT_GT(low.triangles.size(), 500U);
      EXPECT_EQ(low.triangles, Reversed(high.triangles));
      ASSERT_EQ(low.vertices.size(), high.vertices.size());
      for (const auto& [key, vertex] : low.vertices) {
        const Vertex& other = high.vertices.at(key);
        ASSERT_EQ(vertex.position, other.position);
        ASSERT_EQ(vertex.normal, -other.normal);
      }
    }
  }
}

// The triangles in cells whose samples are all a or b. No triangle lies in a face, so its middle
// tells the cell.
std::multiset<Triangle> InCellsOf(const Volume& volume, const Surface& surface, int a, int b) {
  const Index3& dims = volume.geometry.sample_dims;
  std::multiset<Triangle> result;
  for (const Triangle& t : surface.triangles) {
    Vec3f middle;
    for (const std::int64_t key : t) {
      middle = middle + surface.vertices.at(key).position * (1.0F / 3);
    }
    bool has_both_only = true;
    for (int c = 0; c < 8; ++c) {
      const std::int64_t at = static_cast<std::int64_t>(middle.x) + (c & 1) +
                              dims.x * (static_cast<std::int64_t>(middle.y) + (c >> 1 & 1) +
                                        dims.y * (static_cast<std::int64_t>(middle.z) + (c >> 2)));
      const int sample = volume.bytes[static_cast<std::size_t>(at)];
      has_both_only = has_both_only && (sample == a || sample == b);
    }
    if (has_both_only) {
      result.insert(t);
    }
  }
  return result;
}

TEST(LabelSurfaceTest, LabelsThatMeetShareTheirTrianglesInCellsOfTwo) {
  // Patches of four labels: many cells have two.
  const Index3 dims{20, 18, 16};
  Volume volume = NoiseOfLabels(1, dims, ScalarType::kUint8, 1);
  for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
    const std::int64_t patch =
        i % dims.x / 4 + 7 * (i / dims.x % dims.y / 3) + 63 * (i / dims.x / dims.y / 5);
    const bool is_noise = base::RandomBits(6, static_cast<std::uint64_t>(i)) % 8 == 0;
    SetSample(&volume, i,
              static_cast<double>(base::RandomBits(is_noise ? 4 : 5, static_cast<std::uint64_t>(
                                                                         is_noise ? i : patch)) %
                                  4));
  }
  std::size_t shared = 0;
  for (int a = 0; a < 4; ++a) {
    for (int b = a + 1; b < 4; ++b) {
      const InsideRule rule_a = InsideRule::OfLabels({static_cast<double>(a)});
      const InsideRule rule_b = InsideRule::OfLabels({static_cast<double>(b)});
      const std::multiset<Triangle> a_triangles =
          InCellsOf(volume, Join(ExtractBlocks(volume, {8, 8, 8}, rule_a)), a, b);
      const std::multiset<Triangle> b_triangles =
          InCellsOf(volume, Join(ExtractBlocks(volume, {5, 4, 7}, rule_b)), a, b);
      EXPECT_EQ(a_triangles, Reversed(b_triangles)) << a << ", " << b;
      shared += a_triangles.size();
    }
  }
  EXPECT_GT(shared, 1000U);
}

double DegreesBetween(const Vec3d& a, const Vec3d& b) {
  return std::acos(std::clamp(math::Dot(math::Normalized(a), math::Normalized(b)), -1.0, 1.0)) *
         57.29577951308232;
}

// The figures of docs/numerics.md, "Labels".
TEST(LabelSurfaceTest, NormalsOfABallAreNearerToTheTrueOnesThanDifferences) {
  const Index3 dims{64, 64, 64};
  const Vec3d center{31.3, 31.6, 31.45};
  Volume volume = NoiseOfLabels(1, dims, ScalarType::kUint8, 1);
  volume.geometry = {};
  volume.geometry.sample_dims = dims;
  for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
    const Vec3d p{static_cast<double>(i % 64), static_cast<double>(i / 64 % 64),
                  static_cast<double>(i / 4096)};
    SetSample(&volume, i, math::Length(p - center) <= 24 ? 7 : 3);
  }
  const auto angles = [&](const InsideRule& rule) {
    double largest = 0;
    double sum = 0;
    std::size_t count = 0;
    for (const BlockMesh& mesh : ExtractBlocks(volume, {64, 64, 64}, rule)) {
      for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
        const Vec3f& p = mesh.positions[i];
        const Vec3f& n = mesh.normals[i];
        const double angle = DegreesBetween(
            Vec3d{static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)} -
                center,
            {static_cast<double>(n.x), static_cast<double>(n.y), static_cast<double>(n.z)});
        largest = std::max(largest, angle);
        sum += angle;
        ++count;
      }
    }
    EXPECT_GT(count, 5000U);
    return std::pair(largest, sum / static_cast<double>(count));
  };
  const auto [sobel, sobel_mean] = angles(InsideRule::OfLabels({7}));
  // The same surface by central differences: the marks' isovalue.
  const auto [plain, plain_mean] = angles(InsideRule::OfIsovalue(5));
  EXPECT_LT(sobel, 24);
  EXPECT_LT(sobel_mean, 6.5);
  EXPECT_GT(plain, 47);
  EXPECT_GT(plain_mean, 13.9);
}

TEST(LabelSurfaceTest, ValuesOfAnotherFieldAreThoseOfTheMiddle) {
  const Index3 dims{9, 8, 7};
  const Volume volume = NoiseOfLabels(3, dims, ScalarType::kUint16, 3);
  const std::string field = testing::SampleNoise(4, dims, ScalarType::kFloat32, 100);
  const volume::BlockLayout layout = volume::BlockLayout::Make(dims, {16, 16, 16}).value();
  BlockExtractor extractor(volume.geometry, layout);
  const InsideRule rule = InsideRule::OfLabels({1});
  BlockMesh mesh;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, rule, &mesh);
  const mesh::BlockMeshView view = extractor.ExtractWithField(
      {0, volume.type, volume.bytes.data()}, rule, {0, ScalarType::kFloat32, field.data()});
  ASSERT_GT(view.positions.size(), 100U);
  ASSERT_EQ(view.values.size(), view.positions.size());
  const std::array<std::int64_t, 3> strides{1, dims.x, dims.x * dims.y};
  for (std::size_t i = 0; i < view.positions.size(); ++i) {
    const std::int64_t lower = mesh.edge_keys[i] / 3;
    const std::int64_t upper = lower + strides[static_cast<std::size_t>(mesh.edge_keys[i] % 3)];
    const auto at = [&](std::int64_t sample) {
      return static_cast<double>(base::LoadLittleEndian<float>(field.data() + 4 * sample));
    };
    EXPECT_EQ(view.values.narrow()[i],
              static_cast<float>(at(lower) + 0.5 * (at(upper) - at(lower))));
  }
}

InsideRule SmoothLabels(std::vector<double> labels) {
  return InsideRule::OfLabels(std::move(labels), /*smooths=*/true);
}

// The position of the smooth vertex on an edge of the whole volume.
Vec3f SmoothPosition(const Volume& volume, std::int64_t key) {
  const Index3& dims = volume.geometry.sample_dims;
  const std::int64_t sample = key / 3;
  const int axis = static_cast<int>(key % 3);
  const Index3 lower{sample % dims.x, sample / dims.x % dims.y, sample / (dims.x * dims.y)};
  Vec3d position{static_cast<double>(lower.x), static_cast<double>(lower.y),
                 static_cast<double>(lower.z)};
  position[axis] +=
      SmoothFraction({0, volume.type, volume.bytes.data()}, {{0, 0, 0}, dims}, lower, axis);
  return {static_cast<float>(position.x), static_cast<float>(position.y),
          static_cast<float>(position.z)};
}

TEST(LabelSurfaceTest, SmoothVerticesFollowFromTheWholeVolumeForEveryTypeAndBlockSize) {
  for (const ScalarType type : kAllTypes) {
    Volume volume = NoiseOfLabels(7, {11, 9, 7}, type, 4);
    if (type == ScalarType::kFloat32 || type == ScalarType::kFloat64) {
      SetSample(&volume, 200, std::numeric_limits<double>::quiet_NaN());
    }
    // Only the places of vertices change.
    Surface expected = Reference(volume, InsideRule::OfLabels({1, 3})).Extract();
    std::size_t moved = 0;
    for (auto& [key, vertex] : expected.vertices) {
      const Vec3f position = SmoothPosition(volume, key);
      moved += position == vertex.position ? 0U : 1U;
      vertex.position = position;
    }
    EXPECT_GT(moved, expected.vertices.size() / 2);
    for (const Index3& block_cells : kBlockSizes) {
      ExpectEquals(expected, volume, block_cells, SmoothLabels({1, 3}));
    }
  }
}

TEST(LabelSurfaceTest, SmoothLabelsThatMeetKeepTheirCommonVertices) {
  const Volume volume = NoiseOfLabels(4, {14, 12, 10}, ScalarType::kUint8, 3);
  std::map<std::int64_t, Vec3f> places;
  std::size_t common = 0;
  for (const std::vector<double>& labels :
       {std::vector<double>{0}, {1}, {2}, {0, 1}, {0, 2}, {1, 2}}) {
    const Surface surface = Join(ExtractBlocks(volume, {5, 4, 3}, SmoothLabels(labels)));
    for (const auto& [key, vertex] : surface.vertices) {
      const auto [at, is_new] = places.try_emplace(key, vertex.position);
      common += is_new ? 0U : 1U;
      EXPECT_EQ(at->second, vertex.position);
    }
  }
  EXPECT_GT(common, places.size());
}

// The figures of docs/labels.md, "Smooth surfaces".
TEST(LabelSurfaceTest, ASmoothBallIsNearerToTheTrueOne) {
  const Index3 dims{64, 64, 64};
  const Vec3d center{31.3, 31.6, 31.45};
  constexpr double kRadius = 24;
  Volume volume = NoiseOfLabels(1, dims, ScalarType::kUint8, 1);
  for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
    const Vec3d at{static_cast<double>(i % dims.x), static_cast<double>(i / dims.x % dims.y),
                   static_cast<double>(i / dims.x / dims.y)};
    SetSample(&volume, i, math::Length(at - center) <= kRadius ? 5 : 0);
  }
  const auto rms_of = [&](const InsideRule& rule) {
    double sum = 0;
    const Surface surface = Join(ExtractBlocks(volume, {16, 16, 16}, rule));
    for (const auto& [key, vertex] : surface.vertices) {
      const Vec3d at{vertex.position.x, vertex.position.y, vertex.position.z};
      const double error = math::Length(at - center) - kRadius;
      sum += error * error;
    }
    return std::sqrt(sum / static_cast<double>(surface.vertices.size()));
  };
  const double rough = rms_of(InsideRule::OfLabels({5}));
  const double smooth = rms_of(SmoothLabels({5}));
  EXPECT_GT(rough, 0.203);
  EXPECT_LT(smooth, 0.105);
}

TEST(LabelSurfaceTest, ValuesOfAnotherFieldAreThoseOfTheSmoothPlace) {
  const Index3 dims{9, 8, 7};
  const Volume volume = NoiseOfLabels(3, dims, ScalarType::kUint16, 3);
  for (const ScalarType type : {ScalarType::kFloat32, ScalarType::kFloat64}) {
    const std::string field = testing::SampleNoise(4, dims, type, 100);
    const volume::BlockLayout layout = volume::BlockLayout::Make(dims, {16, 16, 16}).value();
    BlockExtractor extractor(volume.geometry, layout);
    BlockMesh mesh;
    extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, SmoothLabels({1}), &mesh);
    const mesh::BlockMeshView view = extractor.ExtractWithField(
        {0, volume.type, volume.bytes.data()}, SmoothLabels({1}), {0, type, field.data()});
    ASSERT_EQ(view.values.size(), mesh.positions.size());
    const std::array<std::int64_t, 3> strides{1, dims.x, dims.x * dims.y};
    volume::VisitScalarType(type, [&]<typename T>() {
      const auto at = [&](std::int64_t sample) {
        return static_cast<double>(
            base::LoadLittleEndian<T>(field.data() + static_cast<std::size_t>(sample) * sizeof(T)));
      };
      for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
        const std::int64_t lower = mesh.edge_keys[i] / 3;
        const std::int64_t upper = lower + strides[static_cast<std::size_t>(mesh.edge_keys[i] % 3)];
        const Index3 from{lower % dims.x, lower / dims.x % dims.y, lower / (dims.x * dims.y)};
        const double t = SmoothFraction({0, volume.type, volume.bytes.data()}, {{0, 0, 0}, dims},
                                        from, static_cast<int>(mesh.edge_keys[i] % 3));
        const double expected = at(lower) + t * (at(upper) - at(lower));
        const double actual = type == ScalarType::kFloat64
                                  ? view.values.wide()[i]
                                  : static_cast<double>(view.values.narrow()[i]);
        EXPECT_EQ(actual, type == ScalarType::kFloat64
                              ? expected
                              : static_cast<double>(static_cast<float>(expected)));
      }
    });
  }
}

TEST(LabelSurfaceTest, ARuleOfAnIsovalueIsTheIsosurface) {
  const Volume volume = NoiseOfLabels(3, {9, 8, 7}, ScalarType::kUint8, 6);
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(volume.geometry.sample_dims, {16, 16, 16}).value();
  BlockExtractor extractor(volume.geometry, layout);
  BlockMesh expected;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, 2.5, &expected);
  // Labels between, so that nothing of them stays.
  BlockMesh labels;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, InsideRule::OfLabels({2, 3}),
                                &labels);
  EXPECT_NE(labels.indices, expected.indices);
  BlockMesh actual;
  extractor.ExtractWithEdgeKeys({0, volume.type, volume.bytes.data()}, InsideRule::OfIsovalue(2.5),
                                &actual);
  EXPECT_EQ(actual.positions, expected.positions);
  EXPECT_EQ(actual.normals, expected.normals);
  EXPECT_EQ(actual.indices, expected.indices);
  EXPECT_EQ(actual.edge_keys, expected.edge_keys);
}

}  // namespace
}  // namespace isoscope::extract
