#include "core/extract/cell_label.h"

#include <array>
#include <cmath>
#include <cstddef>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/extract/case_table.h"

namespace isoscope::extract {
namespace {

using volume::InsideRule;

TEST(LabelInCellTest, IsTheInsideEndOfTheNearestCrossedEdge) {
  // Label 3 at corner 0, label 7 at corner 7, 5 elsewhere.
  const std::array<double, 8> samples{3, 5, 5, 5, 5, 5, 5, 7};
  const math::Index3 cell{10, 20, 30};
  const InsideRule both = InsideRule::OfLabels({3, 7});
  EXPECT_EQ(LabelInCell(samples, cell, {10.4, 20.1, 30.1}, both), 3);
  EXPECT_EQ(LabelInCell(samples, cell, {10.9, 20.6, 30.9}, both), 7);
  // The inside end of the same edges for the label around.
  EXPECT_EQ(LabelInCell(samples, cell, {10.4, 20.1, 30.1}, InsideRule::OfLabels({5})), 5);
}

TEST(LabelInCellTest, OnAVertexItIsTheLabelOfItsEdge) {
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    std::array<double, 8> samples{};
    for (std::size_t c = 0; c < 8; ++c) {
      samples[c] = std::floor(5 * base::RandomUnit(seed, c));
    }
    const InsideRule rule = InsideRule::OfLabels({1, 2});
    for (int edge = 0; edge < 12; ++edge) {
      const EdgeCorners corners = CornersOfEdge(edge);
      const double a = samples[static_cast<std::size_t>(corners.lower)];
      const double b = samples[static_cast<std::size_t>(corners.upper)];
      if (rule.IsInside(a) == rule.IsInside(b)) {
        continue;
      }
      math::Vec3d middle{static_cast<double>(corners.lower & 1),
                         static_cast<double>(corners.lower >> 1 & 1),
                         static_cast<double>(corners.lower >> 2)};
      middle[edge / 4] += 0.5;
      EXPECT_EQ(LabelInCell(samples, {0, 0, 0}, middle, rule), rule.IsInside(a) ? a : b)
          << seed << ", edge " << edge;
    }
  }
}

TEST(LabelInCellTest, OfEquallyNearEdgesTheLowestCounts) {
  // Edges 0 and 1 run along x; the point is half-way between their middles.
  const std::array<double, 8> samples{3, 5, 4, 5, 5, 5, 5, 5};
  EXPECT_EQ(LabelInCell(samples, {0, 0, 0}, {0.5, 0.5, 0}, InsideRule::OfLabels({3, 4})), 3);
}

TEST(LabelInCellTest, WithoutSurfaceThereIsNoLabel) {
  std::array<double, 8> samples{};
  samples.fill(3);
  const InsideRule rule = InsideRule::OfLabels({3});
  EXPECT_FALSE(LabelInCell(samples, {0, 0, 0}, {0.5, 0.5, 0.5}, rule).has_value());
  samples[0] = 1;
  EXPECT_TRUE(LabelInCell(samples, {0, 0, 0}, {0.5, 0.5, 0.5}, rule).has_value());
  samples[5] = std::nan("");
  EXPECT_FALSE(LabelInCell(samples, {0, 0, 0}, {0.5, 0.5, 0.5}, rule).has_value());
}

}  // namespace
}  // namespace isoscope::extract
