// Properties of all 256 cases, each checked by its definition:
//
// - A case and its complement have the same triangles, reversed: two labels that meet are
//   watertight.
// - The segments on a face follow from its four signs alone, so neighbouring cells fit.
// - Triangles use exactly the crossed edges, and no diagonal lies in a face.

#include "core/extract/label_case_table.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::extract {
namespace {

using Segment = std::pair<int, int>;  // from edge, to edge
using Triangle = std::array<int, 3>;

bool IsInside(std::size_t cell_case, int corner) { return (cell_case >> corner & 1) != 0; }

bool OnFace(int edge, int axis, int side) {
  const EdgeCorners corners = CornersOfEdge(edge);
  return (corners.lower >> axis & 1) == side && (corners.upper >> axis & 1) == side;
}

// Turned so that the lowest edge comes first; sorted.
std::vector<Triangle> TrianglesOf(std::size_t cell_case) {
  const LabelCaseTable& table = GetLabelCaseTable();
  std::vector<Triangle> triangles;
  for (std::size_t i = 0; i < table.TriangleCountOf(cell_case); ++i) {
    const auto edges = table.EdgesOf(cell_case, i);
    Triangle triangle{edges[0], edges[1], edges[2]};
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                triangle.end());
    triangles.push_back(triangle);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

// The directed sides that have no opposite: the boundary of the case's surface.
std::set<Segment> BoundaryOf(std::size_t cell_case) {
  std::set<Segment> sides;
  for (const Triangle& t : TrianglesOf(cell_case)) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_TRUE(sides.insert({t[k], t[(k + 1) % 3]}).second) << cell_case << ": a side twice";
    }
  }
  std::set<Segment> boundary;
  for (const Segment& side : sides) {
    if (sides.count({side.second, side.first}) == 0) {
      boundary.insert(side);
    }
  }
  return boundary;
}

TEST(LabelCaseTableTest, ComplementsHaveTheSameTrianglesReversed) {
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    std::vector<Triangle> reversed;
    for (const Triangle& t : TrianglesOf(cell_case ^ 255)) {
      reversed.push_back({t[0], t[2], t[1]});
    }
    std::sort(reversed.begin(), reversed.end());
    EXPECT_EQ(TrianglesOf(cell_case), reversed) << "case " << cell_case;
  }
}

TEST(LabelCaseTableTest, EveryCrossedEdgeIsUsedAndNoOther) {
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    std::set<int> used;
    for (const Triangle& t : TrianglesOf(cell_case)) {
      used.insert(t.begin(), t.end());
    }
    for (int edge = 0; edge < 12; ++edge) {
      const EdgeCorners corners = CornersOfEdge(edge);
      EXPECT_EQ(used.count(edge) == 1,
                IsInside(cell_case, corners.lower) != IsInside(cell_case, corners.upper))
          << "case " << cell_case << ", edge " << edge;
    }
  }
}

// The segments that a face must have, written down by its signs: each cuts off the corners that its
// vertices are next to, with the inside on one hand. The face is that of `axis` and `side`.
std::set<Segment> SegmentsOfFace(std::size_t cell_case, int axis, int side) {
  // The corners, counter-clockwise seen from outside the cell.
  const int u = 1 << (axis + 1) % 3;
  const int v = 1 << (axis + 2) % 3;
  const int base = side << axis;
  const std::array<int, 4> corners =
      side == 1 ? std::array<int, 4>{base, base | u, base | u | v, base | v}
                : std::array<int, 4>{base, base | v, base | u | v, base | u};
  const auto edge_after = [&](std::size_t i) {
    const int a = corners[i % 4];
    const int b = corners[(i + 1) % 4];
    for (int edge = 0; edge < 12; ++edge) {
      if (CornersOfEdge(edge).lower == std::min(a, b) && CornersOfEdge(edge).upper == (a | b)) {
        return edge;
      }
    }
    return -1;
  };
  const auto is_in = [&](std::size_t i) { return IsInside(cell_case, corners[i % 4]); };
  std::set<Segment> segments;
  const bool is_ambiguous = is_in(0) == is_in(2) && is_in(1) == is_in(3) && is_in(0) != is_in(1);
  if (is_ambiguous) {
    // corners[0] is the lowest, so corners 0 and 2 are cut off, be they inside or outside.
    for (const std::size_t i : {std::size_t{0}, std::size_t{2}}) {
      const int before = edge_after(i + 3);
      const int after = edge_after(i);
      segments.insert(is_in(i) ? Segment{before, after} : Segment{after, before});
    }
    return segments;
  }
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t length = 1; length < 4 && !is_in(i); ++length) {
      bool is_run = !is_in(i + length + 1);
      for (std::size_t k = 1; k <= length; ++k) {
        is_run = is_run && is_in(i + k);
      }
      if (is_run) {
        segments.insert({edge_after(i), edge_after(i + length)});
      }
    }
  }
  return segments;
}

TEST(LabelCaseTableTest, TheBoundaryOnAFaceFollowsFromItsSigns) {
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    const std::set<Segment> boundary = BoundaryOf(cell_case);
    std::set<Segment> expected;
    for (int axis = 0; axis < 3; ++axis) {
      for (int side = 0; side < 2; ++side) {
        expected.merge(SegmentsOfFace(cell_case, axis, side));
      }
    }
    EXPECT_EQ(boundary, expected) << "case " << cell_case;
  }
}

TEST(LabelCaseTableTest, NoDiagonalLiesInAFace) {
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    const std::set<Segment> boundary = BoundaryOf(cell_case);
    for (const Triangle& t : TrianglesOf(cell_case)) {
      for (std::size_t k = 0; k < 3; ++k) {
        if (boundary.count({t[k], t[(k + 1) % 3]}) == 1) {
          continue;
        }
        for (int axis = 0; axis < 3; ++axis) {
          for (int side = 0; side < 2; ++side) {
            EXPECT_FALSE(OnFace(t[k], axis, side) && OnFace(t[(k + 1) % 3], axis, side))
                << "case " << cell_case;
          }
        }
      }
    }
  }
}

// The counts that docs/numerics.md tells.
TEST(LabelCaseTableTest, SixTrianglesAreTheMostAndFourteenCasesHaveThem) {
  std::map<std::size_t, int> cases;  // by number of triangles
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    ++cases[GetLabelCaseTable().TriangleCountOf(cell_case)];
  }
  const std::map<std::size_t, int> expected{{0, 2},  {1, 16}, {2, 50}, {3, 72},
                                            {4, 62}, {5, 40}, {6, 14}};
  EXPECT_EQ(cases, expected);
}

TEST(LabelCaseTableTest, LanesAreThoseOfTheEdges) {
  const LabelCaseTable& table = GetLabelCaseTable();
  for (std::size_t cell_case = 0; cell_case < 256; ++cell_case) {
    for (std::size_t i = 0; i < table.TriangleCountOf(cell_case); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const int edge = table.EdgesOf(cell_case, i)[k];
        const int lane = i < kMaxTrianglesPerCell
                             ? table.first_triangles.lanes[cell_case][3 * i + k]
                             : table.last_lanes[cell_case][k];
        EXPECT_EQ(lane, 4 * CornersOfEdge(edge).lower + edge / 4);
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::extract
