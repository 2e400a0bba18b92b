// The box is compared with brute force over the volume, for every type, rule and cut, and with the
// triangles of the extractor.

#include "core/extract/active_cells.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/volume/cell_samples.h"
#include "core/volume/scalar_type.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

using volume::InsideRule;
using volume::ScalarType;

constexpr math::Index3 kDims{13, 11, 9};

bool CountsAll(const math::Index3& /*cell*/) { return true; }

// The box of a volume's active cells, from all samples.
template <typename CountsFn>
math::IndexBox BruteForce(ScalarType type, const std::string& bytes,
                          const std::vector<InsideRule>& rules, const CountsFn& counts) {
  math::IndexBox box;
  for (std::int64_t z = 0; z + 1 < kDims.z; ++z) {
    for (std::int64_t y = 0; y + 1 < kDims.y; ++y) {
      for (std::int64_t x = 0; x + 1 < kDims.x; ++x) {
        const std::array<double, 8> samples =
            volume::SamplesOfCell({0, type, bytes.data()}, {{0, 0, 0}, kDims}, {x, y, z});
        for (const InsideRule& rule : rules) {
          int inside = 0;
          bool has_nan = false;
          for (const double sample : samples) {
            inside += rule.IsInside(sample) ? 1 : 0;
            has_nan = has_nan || std::isnan(sample);
          }
          if (!has_nan && inside > 0 && inside < 8 && counts(math::Index3{x, y, z})) {
            box.Add({{x, y, z}, {x + 1, y + 1, z + 1}});
          }
        }
      }
    }
  }
  return box;
}

// The same, block by block.
template <typename CountsFn>
math::IndexBox ByBlocks(ScalarType type, const std::string& bytes, std::int64_t edge,
                        const std::vector<InsideRule>& rules, const CountsFn& counts) {
  const auto layout = volume::BlockLayout::Make(kDims, {edge, edge, edge}).value();
  math::IndexBox box;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, type, bytes, id);
    const math::IndexBox cells = BoxOfActiveCells(layout, {id, type, block.data()}, rules, counts);
    EXPECT_TRUE(layout.CellsOf(id).Covers(cells)) << id;
    box.Add(cells);
  }
  return box;
}

TEST(BoxOfActiveCellsTest, IsThatOfTheVolumeForEveryTypeRuleAndCut) {
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt16, ScalarType::kFloat32, ScalarType::kFloat64}) {
    const std::string sphere =
        testing::SampleField(testing::SphereField(0.6), kDims, type, 100, 50);
    const std::vector<std::vector<InsideRule>> rules = {
        {InsideRule::OfIsovalue(50)},
        {InsideRule::OfIsovalue(90)},
        {InsideRule::OfIsovalue(50), InsideRule::OfIsovalue(20)},
        {InsideRule::OfLabels({40, 41, 42, 43, 44, 45, 46, 47})},
        {InsideRule::OfIsovalue(1e6)}};
    for (const std::vector<InsideRule>& rule : rules) {
      const math::IndexBox expected = BruteForce(type, sphere, rule, CountsAll);
      for (const std::int64_t edge : {3, 4, 8, 100}) {
        EXPECT_EQ(ByBlocks(type, sphere, edge, rule, CountsAll), expected) << edge;
      }
    }
    EXPECT_FALSE(BruteForce(type, sphere, rules[0], CountsAll).empty());
    EXPECT_TRUE(BruteForce(type, sphere, rules[4], CountsAll).empty());
  }
}

TEST(BoxOfActiveCellsTest, CellsThatTouchNanOrDoNotCountAreLeftOut) {
  std::string bytes;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(kDims.x * kDims.y * kDims.z); ++i) {
    const double noise = base::RandomUnit(7, i);
    base::AppendLittleEndian(
        noise < 0.3 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(noise), &bytes);
  }
  const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(0.9)};
  const auto is_near = [](const math::Index3& cell) { return cell.x > 2 && cell.y < 7; };
  const math::IndexBox all = BruteForce(ScalarType::kFloat32, bytes, rules, CountsAll);
  const math::IndexBox near = BruteForce(ScalarType::kFloat32, bytes, rules, is_near);
  EXPECT_NE(all, near);
  EXPECT_FALSE(near.empty());
  for (const std::int64_t edge : {3, 5, 100}) {
    EXPECT_EQ(ByBlocks(ScalarType::kFloat32, bytes, edge, rules, CountsAll), all);
    EXPECT_EQ(ByBlocks(ScalarType::kFloat32, bytes, edge, rules, is_near), near);
  }
}

TEST(BoxOfActiveCellsTest, EachActiveCellIsVisitedOnceInOrder) {
  const ScalarType type = ScalarType::kFloat32;
  const std::string bytes = testing::SampleField(testing::RandomField(3, 12, 3), kDims, type, 1, 0);
  const InsideRule rule = InsideRule::OfIsovalue(0.8);
  const auto layout = volume::BlockLayout::Make(kDims, {100, 100, 100}).value();
  std::vector<math::Index3> visited;
  ForEachActiveCell(layout, {0, type, bytes.data()}, rule,
                    [&](const math::Index3& cell) { visited.push_back(cell); });
  std::vector<math::Index3> expected;
  for (std::int64_t z = 0; z + 1 < kDims.z; ++z) {
    for (std::int64_t y = 0; y + 1 < kDims.y; ++y) {
      for (std::int64_t x = 0; x + 1 < kDims.x; ++x) {
        int inside = 0;
        for (std::int64_t k = 0; k < 8; ++k) {
          const std::int64_t i =
              x + (k & 1) + kDims.x * (y + (k >> 1 & 1) + kDims.y * (z + (k >> 2)));
          inside += base::LoadLittleEndian<float>(bytes.data() + 4 * i) >= 0.8F ? 1 : 0;
        }
        if (inside > 0 && inside < 8) {
          expected.push_back({x, y, z});
        }
      }
    }
  }
  EXPECT_GT(expected.size(), 20U);
  EXPECT_EQ(visited, expected);
}

// A cell is active exactly if the extractor gives it triangles: of a volume of one block, the vertices
// touch the box on all sides.
TEST(BoxOfActiveCellsTest, TheTrianglesLieInItAndTouchItsOutermostCells) {
  const ScalarType type = ScalarType::kFloat32;
  const std::string bytes = testing::SampleField(testing::RandomField(3, 12, 3), kDims, type, 1, 0);
  const auto layout = volume::BlockLayout::Make(kDims, {100, 100, 100}).value();
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  const std::vector<InsideRule> rules = {InsideRule::OfIsovalue(0.8)};
  const math::IndexBox box = BoxOfActiveCells(layout, {0, type, bytes.data()}, rules, CountsAll);
  BlockExtractor extractor(geometry, layout);
  const mesh::BlockMeshView mesh = extractor.Extract({0, type, bytes.data()}, 0.8);
  ASSERT_FALSE(mesh.positions.empty());
  math::Box3d hull;
  for (const math::Vec3f& p : mesh.positions) {
    hull.Add({static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)});
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GE(hull.min[axis], static_cast<double>(box.begin[axis]));
    EXPECT_LE(hull.min[axis], static_cast<double>(box.begin[axis] + 1));
    EXPECT_LE(hull.max[axis], static_cast<double>(box.end[axis]));
    EXPECT_GE(hull.max[axis], static_cast<double>(box.end[axis] - 1));
  }
}

}  // namespace
}  // namespace isoscope::extract
