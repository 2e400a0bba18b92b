// Properties of all 256 cases, each checked by its definition and not against a stored table:
//
// - Triangles use exactly the crossed edges, at most five triangles a case.
// - The boundary on a face depends on the signs of that face alone, so neighbouring cells fit.
// - Diagonals lie in no face, and follow the rules that make areas agree with VTK's flying edges.
// - The inside is on the right of every boundary segment, seen from outside.

#include "core/extract/case_table.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/math/vec.h"

namespace isoscope::extract {
namespace {

using Segment = std::pair<int, int>;  // from edge, to edge

bool IsInside(int case_number, int corner) { return (case_number >> corner & 1) != 0; }

bool IsCrossed(int case_number, int edge) {
  const EdgeCorners corners = CornersOfEdge(edge);
  return IsInside(case_number, corners.lower) != IsInside(case_number, corners.upper);
}

math::Vec3d CornerPosition(int corner) {
  return {static_cast<double>(corner & 1), static_cast<double>(corner >> 1 & 1),
          static_cast<double>(corner >> 2)};
}

math::Vec3d EdgeMiddle(int edge) {
  const EdgeCorners corners = CornersOfEdge(edge);
  return (CornerPosition(corners.lower) + CornerPosition(corners.upper)) * 0.5;
}

bool OnFace(int edge, int axis, int side) {
  const EdgeCorners corners = CornersOfEdge(edge);
  return (corners.lower >> axis & 1) == side && (corners.upper >> axis & 1) == side;
}

bool ShareFace(int edge_a, int edge_b) {
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      if (OnFace(edge_a, axis, side) && OnFace(edge_b, axis, side)) {
        return true;
      }
    }
  }
  return false;
}

// Directed sides of the case's triangles that have no opposite: the boundary of its surface.
std::vector<Segment> Boundary(int case_number) {
  const CaseTable& table = GetCaseTable();
  const auto row = static_cast<std::size_t>(case_number);
  std::map<Segment, int> sides;
  for (std::size_t i = 0; i < table.triangle_counts[row]; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      ++sides[{table.edges[row][3 * i + k], table.edges[row][3 * i + (k + 1) % 3]}];
    }
  }
  std::vector<Segment> boundary;
  for (const auto& [side, count] : sides) {
    EXPECT_EQ(count, 1) << "case " << case_number << " uses a side twice in one direction";
    if (sides.find({side.second, side.first}) == sides.end()) {
      boundary.push_back(side);
    }
  }
  return boundary;
}

// Sides of the case's triangles that are not on its boundary, each once, lower edge first.
std::set<Segment> Diagonals(int case_number) {
  const CaseTable& table = GetCaseTable();
  const auto row = static_cast<std::size_t>(case_number);
  const std::vector<Segment> boundary = Boundary(case_number);
  std::set<Segment> diagonals;
  for (std::size_t i = 0; i < table.triangle_counts[row]; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Segment side{table.edges[row][3 * i + k], table.edges[row][3 * i + (k + 1) % 3]};
      if (std::find(boundary.begin(), boundary.end(), side) == boundary.end()) {
        diagonals.insert(std::minmax(side.first, side.second));
      }
    }
  }
  return diagonals;
}

// The edges of each loop of the case's boundary.
std::vector<std::set<int>> Loops(int case_number) {
  std::map<int, int> next;
  for (const auto& [from, to] : Boundary(case_number)) {
    next[from] = to;
  }
  std::vector<std::set<int>> loops;
  while (!next.empty()) {
    std::set<int>& loop = loops.emplace_back();
    for (auto it = next.begin(); it != next.end();) {
      loop.insert(it->first);
      const int following = it->second;
      next.erase(it);
      it = next.find(following);
    }
  }
  return loops;
}

std::set<Segment> DiagonalsWithin(int case_number, const std::set<int>& loop) {
  std::set<Segment> within;
  for (const Segment& diagonal : Diagonals(case_number)) {
    if (loop.count(diagonal.first) != 0 && loop.count(diagonal.second) != 0) {
      within.insert(diagonal);
    }
  }
  return within;
}

// From the inside to the outside corner of a crossed edge.
math::Vec3d Direction(int case_number, int edge) {
  const EdgeCorners corners = CornersOfEdge(edge);
  const math::Vec3d up = CornerPosition(corners.upper) - CornerPosition(corners.lower);
  return IsInside(case_number, corners.lower) ? up : up * -1.0;
}

// The four corners of a face as (0,0), (1,0), (0,1), (1,1) of its two axes.
std::vector<int> FaceCorners(int axis, int side) {
  const int u = 1 << (axis == 0 ? 1 : 0);
  const int v = 1 << (axis == 2 ? 1 : 2);
  const int base = side << axis;
  return {base, base | u, base | v, base | u | v};
}

TEST(CaseTableTest, EdgesJoinCornersThatDifferInTheirAxisOnly) {
  std::set<std::pair<int, int>> seen;
  for (int edge = 0; edge < 12; ++edge) {
    const EdgeCorners corners = CornersOfEdge(edge);
    EXPECT_EQ(corners.lower ^ corners.upper, 1 << edge / 4);
    EXPECT_LT(corners.lower, corners.upper);
    EXPECT_TRUE(seen.insert({corners.lower, corners.upper}).second);
  }
}

TEST(CaseTableTest, NoCaseHasMoreThanFiveTrianglesAndOnlyUniformCasesHaveNone) {
  const CaseTable& table = GetCaseTable();
  int most = 0;
  for (std::size_t row = 0; row < 256; ++row) {
    most = std::max<int>(most, table.triangle_counts[row]);
    EXPECT_EQ(table.triangle_counts[row] == 0, row == 0 || row == 255) << "case " << row;
  }
  EXPECT_EQ(most, kMaxTrianglesPerCell);
}

TEST(CaseTableTest, TrianglesUseExactlyTheCrossedEdges) {
  const CaseTable& table = GetCaseTable();
  for (int case_number = 0; case_number < 256; ++case_number) {
    const auto row = static_cast<std::size_t>(case_number);
    std::set<int> used;
    for (std::size_t i = 0; i < 3U * table.triangle_counts[row]; ++i) {
      used.insert(table.edges[row][i]);
    }
    std::set<int> crossed;
    for (int edge = 0; edge < 12; ++edge) {
      if (IsCrossed(case_number, edge)) {
        crossed.insert(edge);
      }
    }
    EXPECT_EQ(used, crossed) << "case " << case_number;
  }
}

// Two cells that share a face see the same four signs there and must draw the same segments in
// opposite directions: then no crack can open between them.
TEST(CaseTableTest, BoundaryOnAFaceDependsOnItsFourSignsOnly) {
  for (int axis = 0; axis < 3; ++axis) {
    // Segments on the face, with edges named by their low-side twins, by the face's four signs.
    std::map<int, std::set<Segment>> expected;
    for (int side = 0; side < 2; ++side) {
      const std::vector<int> corners = FaceCorners(axis, side);
      const auto low_side_edge = [&](int edge) {
        const EdgeCorners ends = CornersOfEdge(edge);
        for (int other = 0; other < 12; ++other) {
          if (CornersOfEdge(other).lower == (ends.lower & ~(1 << axis)) && other / 4 == edge / 4) {
            return other;
          }
        }
        return -1;
      };
      for (int case_number = 0; case_number < 256; ++case_number) {
        int signs = 0;
        for (std::size_t k = 0; k < 4; ++k) {
          signs |= IsInside(case_number, corners[k]) ? 1 << k : 0;
        }
        std::set<Segment> segments;
        for (const auto& [from, to] : Boundary(case_number)) {
          if (OnFace(from, axis, side) && OnFace(to, axis, side)) {
            const Segment segment{low_side_edge(from), low_side_edge(to)};
            segments.insert(side == 0 ? segment : Segment{segment.second, segment.first});
          }
        }
        const auto [entry, is_new] = expected.try_emplace(signs, segments);
        if (!is_new) {
          EXPECT_EQ(entry->second, segments)
              << "case " << case_number << ", axis " << axis << ", side " << side;
        }
      }
    }
    EXPECT_EQ(expected.size(), 16U);
  }
}

TEST(CaseTableTest, EveryBoundarySideLiesInAFaceAndEveryFaceHasItsSegments) {
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::size_t expected = 0;
    for (int axis = 0; axis < 3; ++axis) {
      for (int side = 0; side < 2; ++side) {
        std::size_t crossed = 0;
        for (int edge = 0; edge < 12; ++edge) {
          crossed += OnFace(edge, axis, side) && IsCrossed(case_number, edge) ? 1U : 0U;
        }
        expected += crossed / 2;
      }
    }
    const std::vector<Segment> boundary = Boundary(case_number);
    EXPECT_EQ(boundary.size(), expected) << "case " << case_number;
    for (const auto& [from, to] : boundary) {
      EXPECT_TRUE(ShareFace(from, to)) << "case " << case_number;
    }
  }
}

TEST(CaseTableTest, InsideCornersOfAnAmbiguousFaceAreNeverJoined) {
  for (int case_number = 0; case_number < 256; ++case_number) {
    for (const auto& [from, to] : Boundary(case_number)) {
      const EdgeCorners a = CornersOfEdge(from);
      const EdgeCorners b = CornersOfEdge(to);
      for (int axis = 0; axis < 3; ++axis) {
        for (int side = 0; side < 2; ++side) {
          if (!OnFace(from, axis, side) || !OnFace(to, axis, side)) {
            continue;
          }
          int crossed = 0;
          for (int edge = 0; edge < 12; ++edge) {
            crossed += OnFace(edge, axis, side) && IsCrossed(case_number, edge) ? 1 : 0;
          }
          if (crossed == 4) {
            const int inside_a = IsInside(case_number, a.lower) ? a.lower : a.upper;
            const int inside_b = IsInside(case_number, b.lower) ? b.lower : b.upper;
            EXPECT_EQ(inside_a, inside_b) << "case " << case_number;
          }
        }
      }
    }
  }
}

// A diagonal in a face could be drawn by the neighbour too: an edge with four triangles.
TEST(CaseTableTest, NoDiagonalLiesInAFace) {
  const CaseTable& table = GetCaseTable();
  for (int case_number = 0; case_number < 256; ++case_number) {
    const auto row = static_cast<std::size_t>(case_number);
    const std::vector<Segment> boundary = Boundary(case_number);
    for (std::size_t i = 0; i < table.triangle_counts[row]; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Segment side{table.edges[row][3 * i + k], table.edges[row][3 * i + (k + 1) % 3]};
        if (std::find(boundary.begin(), boundary.end(), side) == boundary.end()) {
          EXPECT_FALSE(ShareFace(side.first, side.second)) << "case " << case_number;
        }
      }
    }
  }
}

// The diagonals of the next four tests make areas agree with those of VTK's flying edges.
TEST(CaseTableTest, NoDiagonalJoinsEdgesOfOppositeDirections) {
  for (int case_number = 0; case_number < 256; ++case_number) {
    for (const auto& [a, b] : Diagonals(case_number)) {
      EXPECT_GE(math::Dot(Direction(case_number, a), Direction(case_number, b)), 0)
          << "case " << case_number << ", edges " << a << ", " << b;
    }
  }
}

TEST(CaseTableTest, LoopsOfFiveEdgesHaveADiagonalBetweenTheirParallelEdgesOfOneDirection) {
  int loop_count = 0;
  for (int case_number = 0; case_number < 256; ++case_number) {
    for (const std::set<int>& loop : Loops(case_number)) {
      if (loop.size() != 5) {
        continue;
      }
      ++loop_count;
      const std::set<Segment> diagonals = DiagonalsWithin(case_number, loop);
      EXPECT_EQ(diagonals.size(), 2U);
      EXPECT_EQ(std::count_if(diagonals.begin(), diagonals.end(),
                              [&](const Segment& diagonal) {
                                return math::Dot(Direction(case_number, diagonal.first),
                                                 Direction(case_number, diagonal.second)) == 1;
                              }),
                1)
          << "case " << case_number;
    }
  }
  EXPECT_EQ(loop_count, 72);
}

TEST(CaseTableTest, LoopsOfSevenEdgesAreFans) {
  int loop_count = 0;
  for (int case_number = 0; case_number < 256; ++case_number) {
    for (const std::set<int>& loop : Loops(case_number)) {
      if (loop.size() != 7) {
        continue;
      }
      ++loop_count;
      const std::set<Segment> diagonals = DiagonalsWithin(case_number, loop);
      EXPECT_EQ(diagonals.size(), 4U);
      EXPECT_TRUE(std::any_of(
          loop.begin(), loop.end(),
          [&](int apex) {
            return std::all_of(diagonals.begin(), diagonals.end(), [&](const Segment& diagonal) {
              return diagonal.first == apex || diagonal.second == apex;
            });
          }))
          << "case " << case_number;
    }
  }
  EXPECT_EQ(loop_count, 24);
}

// Four inside corners in a row round two bends: the outside ones are the mirror image, and so the
// surface favours neither.
TEST(CaseTableTest, ChainsOfFourCornersAreCutByACentralTriangle) {
  int chain_count = 0;
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::vector<int> neighbour_counts;
    for (int corner = 0; corner < 8; ++corner) {
      if (IsInside(case_number, corner)) {
        neighbour_counts.push_back(IsInside(case_number, corner ^ 1) +
                                   IsInside(case_number, corner ^ 2) +
                                   IsInside(case_number, corner ^ 4));
      }
    }
    std::sort(neighbour_counts.begin(), neighbour_counts.end());
    if (neighbour_counts != std::vector<int>{1, 1, 2, 2}) {
      continue;
    }
    ++chain_count;
    const std::set<Segment> diagonals = Diagonals(case_number);
    std::set<int> ends;
    for (const auto& [a, b] : diagonals) {
      ends.insert({a, b});
    }
    EXPECT_EQ(diagonals.size(), 3U) << "case " << case_number;
    EXPECT_EQ(ends.size(), 3U) << "case " << case_number;
  }
  EXPECT_EQ(chain_count, 24);
}

TEST(CaseTableTest, SingleCornersAreCutOffByATriangleThatFacesAway) {
  const CaseTable& table = GetCaseTable();
  for (int corner = 0; corner < 8; ++corner) {
    for (const bool inside : {true, false}) {
      const auto row = static_cast<std::size_t>(inside ? 1 << corner : 255 ^ 1 << corner);
      ASSERT_EQ(table.triangle_counts[row], 1);
      const math::Vec3d a = EdgeMiddle(table.edges[row][0]);
      const math::Vec3d b = EdgeMiddle(table.edges[row][1]);
      const math::Vec3d c = EdgeMiddle(table.edges[row][2]);
      const double away = math::Dot(math::Cross(b - a, c - a), a - CornerPosition(corner));
      EXPECT_EQ(away > 0, inside) << "corner " << corner;
    }
  }
}

// Seen from outside the cell, every boundary segment has the inside on its right: the winding of
// all loops, and with it that of all triangles, is right.
TEST(CaseTableTest, BoundarySegmentsHaveTheInsideOnTheirRight) {
  for (int case_number = 1; case_number < 255; ++case_number) {
    for (const auto& [from, to] : Boundary(case_number)) {
      const EdgeCorners a = CornersOfEdge(from);
      const int inside = IsInside(case_number, a.lower) ? a.lower : a.upper;
      for (int axis = 0; axis < 3; ++axis) {
        for (int side = 0; side < 2; ++side) {
          if (OnFace(from, axis, side) && OnFace(to, axis, side)) {
            math::Vec3d outwards;
            outwards[axis] = side == 1 ? 1 : -1;
            const math::Vec3d along = EdgeMiddle(to) - EdgeMiddle(from);
            const math::Vec3d to_inside = CornerPosition(inside) - EdgeMiddle(from);
            EXPECT_LT(math::Dot(math::Cross(along, to_inside), outwards), 0)
                << "case " << case_number;
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::extract
