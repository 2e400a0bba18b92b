// Generates the table from the rule of docs/numerics.md, "Case table", whose steps these are:
//
//   1. LinkSegments: each face is walked counter-clockwise, seen from outside. One segment cuts off
//      every run of inside corners: from the edge where the walk enters the run to the edge where
//      it leaves. Two diagonal inside corners (the ambiguous face) are two runs, never joined.
//   2. Each crossed edge ends a segment on one of its faces and starts one on the other, so the
//      segments link up to closed loops.
//   3. Triangulate: all triangulations of a loop that have no diagonal in a face of the cell, where
//      the neighbour could have the same one: that edge would have four triangles.
//   4. TriangulateLoop: of these, the ones whose diagonals join edges of like direction, inside to
//      outside: a coarse gradient, so the surface creases least.
//   5. Among these, take the one whose volume is nearest to the middle of the smallest and the
//      largest; then the first one. Both choices make areas agree with those of VTK's flying edges.
//
// Example: case 1 has corner 0 inside, and the crossed edges 0 (along x), 4 (y) and 8 (z). On face
// z = 0 the walk 0, 2, 3, 1 enters the run {0} on edge 0 and leaves it on edge 4; the other faces
// add 4 to 8 and 8 to 0: one triangle 0 4 8, lanes 0 1 2. Case 9 has the diagonal corners 0 and 3
// of that face inside: two triangles, 0 4 8 and 1 5 11, which do not touch.
//
// No case needs more than 5 triangles; 32 cases do. Source: Lorensen and Cline 1987
// (references.bib: lorensen-cline), with a face rule instead of their complementary cases, which
// leave holes.

#include "core/extract/case_table.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <utility>
#include <vector>

#include "core/base/check.h"

namespace isoscope::extract {
namespace {

constexpr int kEdgeCount = 12;
constexpr int kNone = -1;

int EdgeBetween(int corner_a, int corner_b) {
  for (int edge = 0; edge < kEdgeCount; ++edge) {
    const EdgeCorners corners = CornersOfEdge(edge);
    if ((corners.lower == corner_a && corners.upper == corner_b) ||
        (corners.lower == corner_b && corners.upper == corner_a)) {
      return edge;
    }
  }
  base::CheckFailed(__FILE__, __LINE__, "corners are not neighbours");
}

// Returns the corners of the face `axis` = `side`, counter-clockwise seen from outside the cell.
std::array<int, 4> FaceCorners(int axis, int side) {
  const int u = 1 << (axis + 1) % 3;
  const int v = 1 << (axis + 2) % 3;
  const int base = side << axis;
  // u x v points along +axis, which is outwards on side 1.
  return side == 1 ? std::array<int, 4>{base, base | u, base | u | v, base | v}
                   : std::array<int, 4>{base, base | v, base | u | v, base | u};
}

bool ShareFace(int edge_a, int edge_b) {
  const EdgeCorners a = CornersOfEdge(edge_a);
  const EdgeCorners b = CornersOfEdge(edge_b);
  // On a face all four corners agree on the face's axis.
  const int same = ~(a.lower ^ a.upper) & ~(a.lower ^ b.lower) & ~(a.lower ^ b.upper);
  return (same & 7) != 0;
}

bool IsInside(int case_number, int corner) { return (case_number >> corner & 1) != 0; }

// Step 1. Returns next[e]: the crossed edge that follows e on the boundary of the surface, or
// kNone.
std::array<int, kEdgeCount> LinkSegments(int case_number) {
  std::array<int, kEdgeCount> next{};
  next.fill(kNone);
  const auto inside = [&](int corner) { return IsInside(case_number, corner); };
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      const std::array<int, 4> corners = FaceCorners(axis, side);
      for (std::size_t i = 0; i < 4; ++i) {
        if (inside(corners[i]) || !inside(corners[(i + 1) % 4])) {
          continue;
        }
        std::size_t last = (i + 1) % 4;
        while (inside(corners[(last + 1) % 4])) {
          last = (last + 1) % 4;
        }
        const int enter = EdgeBetween(corners[i], corners[(i + 1) % 4]);
        const int leave = EdgeBetween(corners[last], corners[(last + 1) % 4]);
        next[static_cast<std::size_t>(enter)] = leave;
      }
    }
  }
  return next;
}

// Returns 1 - cos of the angle between the directions, inside to outside, of two crossed edges: 0
// if they are parallel, 1 if perpendicular, 2 if opposite.
int DirectionDifference(int case_number, int edge_a, int edge_b) {
  if (edge_a / 4 != edge_b / 4) {
    return 1;
  }
  return IsInside(case_number, CornersOfEdge(edge_a).lower) ==
                 IsInside(case_number, CornersOfEdge(edge_b).lower)
             ? 0
             : 2;
}

// Returns twice the middle of an edge: whole numbers.
std::array<int, 3> DoubledMiddle(int edge) {
  const EdgeCorners corners = CornersOfEdge(edge);
  std::array<int, 3> middle{};
  for (int axis = 0; axis < 3; ++axis) {
    middle[static_cast<std::size_t>(axis)] =
        (corners.lower >> axis & 1) + (corners.upper >> axis & 1);
  }
  return middle;
}

// Returns 48 times the signed volume of the tetrahedron that a triangle between the middles of
// three edges spans with corner 0.
int SpannedVolume(int edge_a, int edge_b, int edge_c) {
  const auto [ax, ay, az] = DoubledMiddle(edge_a);
  const auto [bx, by, bz] = DoubledMiddle(edge_b);
  const auto [cx, cy, cz] = DoubledMiddle(edge_c);
  return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx);
}

struct Triangulation {
  std::vector<int> edges;        // three for each triangle
  int direction_difference = 0;  // summed over the diagonals
  int volume = 0;                // summed over the triangles
};

// Step 3. Returns all triangulations of loop[first..last] without a diagonal in a face of the cell.
// Each has a triangle on the side from first to last, and triangulates both rests.
std::vector<Triangulation> Triangulate(int case_number, const std::vector<int>& loop,
                                       std::size_t first, std::size_t last) {
  if (last - first < 2) {
    return {Triangulation{}};
  }
  std::vector<Triangulation> results;
  for (std::size_t middle = first + 1; middle < last; ++middle) {
    const bool has_left_diagonal = middle - first > 1;
    const bool has_right_diagonal = last - middle > 1;
    if ((has_left_diagonal && ShareFace(loop[first], loop[middle])) ||
        (has_right_diagonal && ShareFace(loop[middle], loop[last]))) {
      continue;
    }
    Triangulation split;
    split.edges = {loop[first], loop[middle], loop[last]};
    split.volume = SpannedVolume(loop[first], loop[middle], loop[last]);
    if (has_left_diagonal) {
      split.direction_difference += DirectionDifference(case_number, loop[first], loop[middle]);
    }
    if (has_right_diagonal) {
      split.direction_difference += DirectionDifference(case_number, loop[middle], loop[last]);
    }
    const std::vector<Triangulation> rights = Triangulate(case_number, loop, middle, last);
    for (const Triangulation& left : Triangulate(case_number, loop, first, middle)) {
      for (const Triangulation& right : rights) {
        Triangulation& whole = results.emplace_back(split);
        for (const Triangulation* side : {&left, &right}) {
          whole.edges.insert(whole.edges.end(), side->edges.begin(), side->edges.end());
          whole.direction_difference += side->direction_difference;
          whole.volume += side->volume;
        }
      }
    }
  }
  return results;
}

// Steps 4 and 5. Returns three edges for each triangle of a loop.
std::vector<int> TriangulateLoop(int case_number, const std::vector<int>& loop) {
  const std::vector<Triangulation> candidates = Triangulate(case_number, loop, 0, loop.size() - 1);
  ISOSCOPE_CHECK(!candidates.empty());
  const auto [least, most] = std::minmax_element(
      candidates.begin(), candidates.end(),
      [](const Triangulation& a, const Triangulation& b) { return a.volume < b.volume; });
  const int twice_middle_volume = least->volume + most->volume;
  const auto rank = [&](const Triangulation& candidate) {
    return std::pair(candidate.direction_difference,
                     std::abs(2 * candidate.volume - twice_middle_volume));
  };
  return std::min_element(
             candidates.begin(), candidates.end(),
             [&](const Triangulation& a, const Triangulation& b) { return rank(a) < rank(b); })
      ->edges;
}

// Step 2 follows the segments of each case to loops, which start at their lowest edge.
CaseTable MakeCaseTable() {
  CaseTable table;
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::array<int, kEdgeCount> next = LinkSegments(case_number);
    std::vector<int> triangles;
    for (std::size_t start = 0; start < kEdgeCount; ++start) {
      std::vector<int> loop;
      for (std::size_t edge = start; next[edge] != kNone;) {
        loop.push_back(static_cast<int>(edge));
        const auto following = static_cast<std::size_t>(next[edge]);
        next[edge] = kNone;
        edge = following;
      }
      if (!loop.empty()) {
        const std::vector<int> edges = TriangulateLoop(case_number, loop);
        triangles.insert(triangles.end(), edges.begin(), edges.end());
      }
    }
    ISOSCOPE_CHECK_LE(triangles.size(), 3 * std::size_t{kMaxTrianglesPerCell});
    const auto row = static_cast<std::size_t>(case_number);
    table.triangle_counts[row] = static_cast<std::uint8_t>(triangles.size() / 3);
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      table.edges[row][i] = static_cast<std::uint8_t>(triangles[i]);
      table.lanes[row][i] =
          static_cast<std::uint8_t>(4 * CornersOfEdge(triangles[i]).lower + triangles[i] / 4);
    }
  }
  return table;
}

}  // namespace

const CaseTable& GetCaseTable() {
  static const CaseTable table = MakeCaseTable();
  return table;
}

}  // namespace isoscope::extract
