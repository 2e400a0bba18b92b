// Loops of worked cases, and what holds for all ways of joining faces. The tables that are made of
// them have tests of their own.

#include "core/extract/cell_loops.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <vector>

#include "gtest/gtest.h"

#include "core/extract/case_table.h"

namespace isoscope::extract {
namespace {

using Loops = std::vector<std::vector<int>>;

TEST(CellLoopsTest, OneCornerIsCutOffByOneTriangle) {
  EXPECT_EQ(LoopsOf(1, 0), (Loops{{0, 4, 8}}));
  // Outside and inside have changed places: the other way round.
  EXPECT_EQ(LoopsOf(254, 0), (Loops{{0, 8, 4}}));
}

TEST(CellLoopsTest, JoinedCornersHaveOneLoopAndSeparatedOnesTwo) {
  // Corners 0 and 3, the diagonal of face z = 0, which is face 4.
  EXPECT_EQ(AmbiguousFacesOf(9), 1U << 4);
  EXPECT_EQ(LoopsOf(9, 0), (Loops{{0, 4, 8}, {1, 5, 11}}));
  EXPECT_EQ(LoopsOf(9, 1U << 4), (Loops{{0, 5, 11, 1, 4, 8}}));
  // Other faces are not ambiguous.
  EXPECT_EQ(LoopsOf(9, 0x2f), LoopsOf(9, 0));
}

TEST(CellLoopsTest, FacesAreAmbiguousWhereDiagonalsDiffer) {
  EXPECT_EQ(AmbiguousFacesOf(0), 0U);
  EXPECT_EQ(AmbiguousFacesOf(0xf), 0U);
  EXPECT_EQ(AmbiguousFacesOf(0x69), 0x3fU);  // corners 0, 3, 5 and 6
  EXPECT_EQ(AmbiguousFacesOf(0x81), 0U);     // opposite corners of the cell
}

// Whatever is joined, a loop runs through each crossed edge once; complements with the other faces
// joined have the same loops backwards.
TEST(CellLoopsTest, LoopsOfAllWaysOfJoiningUseEachCrossedEdgeOnce) {
  for (int cell_case = 0; cell_case < 256; ++cell_case) {
    const unsigned ambiguous = AmbiguousFacesOf(cell_case);
    for (unsigned joined = 0; joined < 64; ++joined) {
      if ((joined & ~ambiguous) != 0) {
        continue;
      }
      std::multiset<int> used;
      std::set<std::vector<int>> loops;
      for (const std::vector<int>& loop : LoopsOf(cell_case, joined)) {
        used.insert(loop.begin(), loop.end());
        loops.insert(loop);
      }
      for (int edge = 0; edge < 12; ++edge) {
        const EdgeCorners corners = CornersOfEdge(edge);
        const bool is_crossed =
            (cell_case >> corners.lower & 1) != (cell_case >> corners.upper & 1);
        EXPECT_EQ(used.count(edge), is_crossed ? 1U : 0U) << cell_case << ", " << joined;
      }
      std::set<std::vector<int>> reversed;
      for (std::vector<int> loop : LoopsOf(cell_case ^ 255, ambiguous & ~joined)) {
        std::reverse(loop.begin() + 1, loop.end());
        reversed.insert(loop);
      }
      EXPECT_EQ(loops, reversed) << cell_case << ", " << joined;
    }
  }
}

TEST(CellLoopsTest, AQuadrangleHasTwoTriangulations) {
  // Corners 0 and 1: the loop 4 8 9 5 or its like, without an edge along x.
  const Loops loops = LoopsOf(3, 0);
  ASSERT_EQ(loops.size(), 1U);
  const std::vector<Triangulation> all = TriangulationsOf(3, loops[0]);
  EXPECT_EQ(all.size(), 2U);
  for (const Triangulation& one : all) {
    EXPECT_EQ(one.edges.size(), 6U);
  }
}

TEST(CellLoopsTest, SomeLoopsHaveNoTriangulation) {
  // The reason why label_case_table.cc can't join faces by their labels: its head tells.
  const Loops loops = LoopsOf(60, 1);
  ASSERT_EQ(loops.size(), 1U);
  EXPECT_EQ(loops[0].size(), 8U);
  EXPECT_TRUE(TriangulationsOf(60, loops[0]).empty());
}

}  // namespace
}  // namespace isoscope::extract
