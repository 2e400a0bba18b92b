#include "core/volume/field_gradient.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/math/matrix.h"
#include "tests/support/block_cutter.h"

namespace isoscope::volume {
namespace {

constexpr math::Index3 kDims{13, 11, 9};

GridGeometry Oblique() {
  GridGeometry geometry;
  geometry.sample_dims = kDims;
  geometry.spacing = {0.5, 1.25, 3};
  geometry.origin = {-7, 11, 0.25};
  geometry.direction.columns = {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.8, 0.6, 0},
                                math::Vec3d{0, 0, 1}};
  return geometry;
}

// Samples of a field of index space.
template <typename Field>
std::string Sample(const Field& field) {
  std::string bytes;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        base::AppendLittleEndian(
            static_cast<double>(field(math::Vec3d{static_cast<double>(x), static_cast<double>(y),
                                                  static_cast<double>(z)})),
            &bytes);
      }
    }
  }
  return bytes;
}

math::Vec3d GradientIn(const GridGeometry& geometry, const std::string& bytes,
                       const math::Index3& block_cells, const math::Vec3d& position) {
  const BlockLayout layout = BlockLayout::Make(kDims, block_cells).value();
  const BlockId id = BlockOfCell(layout, CellAt(layout, position));
  const std::string block = testing::CutBlock(layout, ScalarType::kFloat64, bytes, id);
  return GradientAt(geometry, layout, {id, ScalarType::kFloat64, block.data()}, position);
}

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_NEAR(math::Length(a - b), 0, 1e-9) << a.x << " " << a.y << " " << a.z;
}

TEST(CellAtTest, FacesBelongToTheUpperCellAndTheOutsideToTheNearest) {
  const BlockLayout layout = BlockLayout::Make(kDims, {4, 4, 4}).value();
  EXPECT_EQ(CellAt(layout, {3.9, 4, 0}), (math::Index3{3, 4, 0}));
  EXPECT_EQ(CellAt(layout, {12, -1e-9, 99}), (math::Index3{11, 0, 7}));
  EXPECT_EQ(BlockOfCell(layout, {3, 4, 0}), layout.IdOf({0, 1, 0}));
  EXPECT_EQ(BlockOfCell(layout, {11, 0, 7}), layout.IdOf({2, 0, 1}));
}

// 2 x - 3 y + 0.5 z in the world: one gradient everywhere, borders included.
TEST(GradientAtTest, ALinearFieldHasItsGradientEverywhere) {
  const GridGeometry geometry = Oblique();
  const math::Vec3d expected{2, -3, 0.5};
  const std::string bytes = Sample([&](const math::Vec3d& p) {
    return math::Dot(expected, math::TransformPoint(geometry.world_from_index(), p));
  });
  for (const math::Vec3d& position :
       {math::Vec3d{0, 0, 0}, {12, 10, 8}, {3.25, 7.5, 2.125}, {8, 4, 4}, {11.9, 0.1, 7.7}}) {
    ExpectNear(GradientIn(geometry, bytes, {4, 4, 4}, position), expected);
  }
}

// x y + z^2: central differences are exact inside, and their interpolation, too.
TEST(GradientAtTest, AQuadraticFieldHasItsGradientInside) {
  GridGeometry geometry;
  geometry.sample_dims = kDims;
  geometry.spacing = {1, 2, 0.25};
  const std::string bytes = Sample([](const math::Vec3d& p) { return p.x * p.y + p.z * p.z; });
  ExpectNear(GradientIn(geometry, bytes, {8, 8, 8}, {3.5, 6.25, 4.75}),
             {6.25, 3.5 / 2, 2 * 4.75 / 0.25});
  // At the border z^2 has only the difference to its one neighbour.
  ExpectNear(GradientIn(geometry, bytes, {8, 8, 8}, {3.5, 6.25, 0}), {6.25, 3.5 / 2, 1 / 0.25});
}

TEST(GradientAtTest, HowTheVolumeIsCutDoesNotShowInABit) {
  std::uint64_t counter = 0;
  const auto uniform = [&](double high) { return high * base::RandomUnit(3, counter++); };
  const std::string bytes = Sample([&](const math::Vec3d&) { return uniform(100); });
  for (int i = 0; i < 500; ++i) {
    math::Vec3d position{uniform(12), uniform(10), uniform(8)};
    if (i % 3 == 0) {
      position.x = 4 * std::floor(uniform(3));  // on a face
    }
    const math::Vec3d whole = GradientIn(Oblique(), bytes, {16, 16, 16}, position);
    EXPECT_EQ(GradientIn(Oblique(), bytes, {4, 4, 4}, position), whole);
    EXPECT_EQ(GradientIn(Oblique(), bytes, {1, 3, 5}, position), whole);
  }
}

TEST(GradientAtTest, NeighboursThatAreNotFiniteAreLeftOut) {
  GridGeometry geometry;
  geometry.sample_dims = kDims;
  const std::string bytes = Sample([](const math::Vec3d& p) {
    return p.x == 6   ? std::numeric_limits<double>::quiet_NaN()
           : p.y == 3 ? std::numeric_limits<double>::infinity()
                      : 10 * p.x + p.y;
  });
  ExpectNear(GradientIn(geometry, bytes, {8, 8, 8}, {5, 7, 4}), {10, 1, 0});
  ExpectNear(GradientIn(geometry, bytes, {8, 8, 8}, {2, 4, 4}), {10, 1, 0});
  // Between NaN samples: x has finite neighbours on both sides, the others have none.
  ExpectNear(GradientIn(geometry, bytes, {8, 8, 8}, {6, 7, 4}), {10, 0, 0});
}

}  // namespace
}  // namespace isoscope::volume
