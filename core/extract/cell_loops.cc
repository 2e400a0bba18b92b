// Steps 1 to 3 of docs/numerics.md, "Case table":
//
//   1. LinkSegments: each face is walked counter-clockwise, seen from outside. One segment cuts off
//      every run of inside corners: from the edge where the walk enters the run to the edge where
//      it leaves. Two diagonal inside corners (the ambiguous face) are two runs. Where such a face
//      is joined, the segment cuts off an outside corner: from the edge where the walk leaves it to
//      the edge where it came.
//   2. LoopsOf: each crossed edge ends a segment on one of its faces and starts one on the other,
//      so the segments link up to closed loops.
//   3. TriangulationsOf: a diagonal in a face of the cell could also be the neighbour's, and that
//      edge would have four triangles; so there are none.
//
// Example: case 9 has the diagonal corners 0 and 3 of face z = 0 inside. Separated, its loops are
// 0 4 8 and 1 5 11, one around each corner. Joined, face z = 0 has the segments from 0 to 5 and
// from 1 to 4: one loop of six edges.

#include "core/extract/cell_loops.h"

#include <cstddef>
#include <utility>

#include "core/base/check.h"
#include "core/extract/case_table.h"

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

bool ShareFace(int edge_a, int edge_b) {
  const EdgeCorners a = CornersOfEdge(edge_a);
  const EdgeCorners b = CornersOfEdge(edge_b);
  // On a face all four corners agree on the face's axis.
  const int same = ~(a.lower ^ a.upper) & ~(a.lower ^ b.lower) & ~(a.lower ^ b.upper);
  return (same & 7) != 0;
}

bool IsInside(int case_number, int corner) { return (case_number >> corner & 1) != 0; }

bool IsAmbiguous(int case_number, const std::array<int, 4>& corners) {
  return IsInside(case_number, corners[0]) == IsInside(case_number, corners[2]) &&
         IsInside(case_number, corners[1]) == IsInside(case_number, corners[3]) &&
         IsInside(case_number, corners[0]) != IsInside(case_number, corners[1]);
}

// Step 1. Returns next[e]: the crossed edge that follows e on the boundary of the surface, or
// kNone.
std::array<int, kEdgeCount> LinkSegments(int case_number, unsigned joined_faces) {
  std::array<int, kEdgeCount> next{};
  next.fill(kNone);
  const auto inside = [&](int corner) { return IsInside(case_number, corner); };
  for (int face = 0; face < kFaceCount; ++face) {
    const std::array<int, 4> corners = CornersOfFace(face);
    const bool is_joined = (joined_faces >> face & 1) != 0 && IsAmbiguous(case_number, corners);
    for (std::size_t i = 0; i < 4; ++i) {
      if (inside(corners[i]) || !inside(corners[(i + 1) % 4])) {
        continue;
      }
      const int enter = EdgeBetween(corners[i], corners[(i + 1) % 4]);
      int leave = 0;
      if (is_joined) {
        leave = EdgeBetween(corners[(i + 3) % 4], corners[i]);
      } else {
        std::size_t last = (i + 1) % 4;
        while (inside(corners[(last + 1) % 4])) {
          last = (last + 1) % 4;
        }
        leave = EdgeBetween(corners[last], corners[(last + 1) % 4]);
      }
      next[static_cast<std::size_t>(enter)] = leave;
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

// Returns all triangulations of loop[first..last] without a diagonal in a face of the cell.
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

}  // namespace

std::array<int, 4> CornersOfFace(int face) {
  const int axis = face / 2;
  const int side = face % 2;
  const int u = 1 << (axis + 1) % 3;
  const int v = 1 << (axis + 2) % 3;
  const int base = side << axis;
  // u x v points along +axis, which is outwards on side 1.
  return side == 1 ? std::array<int, 4>{base, base | u, base | u | v, base | v}
                   : std::array<int, 4>{base, base | v, base | u | v, base | u};
}

unsigned AmbiguousFacesOf(int case_number) {
  unsigned faces = 0;
  for (int face = 0; face < kFaceCount; ++face) {
    faces |= IsAmbiguous(case_number, CornersOfFace(face)) ? 1U << face : 0U;
  }
  return faces;
}

std::vector<std::vector<int>> LoopsOf(int case_number, unsigned joined_faces) {
  std::array<int, kEdgeCount> next = LinkSegments(case_number, joined_faces);
  std::vector<std::vector<int>> loops;
  for (std::size_t start = 0; start < kEdgeCount; ++start) {
    std::vector<int> loop;
    for (std::size_t edge = start; next[edge] != kNone;) {
      loop.push_back(static_cast<int>(edge));
      const auto following = static_cast<std::size_t>(next[edge]);
      next[edge] = kNone;
      edge = following;
    }
    if (!loop.empty()) {
      loops.push_back(std::move(loop));
    }
  }
  return loops;
}

std::vector<Triangulation> TriangulationsOf(int case_number, const std::vector<int>& loop) {
  return Triangulate(case_number, loop, 0, loop.size() - 1);
}

}  // namespace isoscope::extract
