// Generates the table from the rule of docs/numerics.md, "Case table", whose steps these are:
//
//   1. On each face one segment cuts off every run of inside corners. Two diagonal inside corners
//      (the ambiguous face) are two runs, never joined.
//   2. The segments link up to closed loops (LoopsOf in cell_loops.h, which has steps 1 to 3).
//   3. TriangulationsOf: those of a loop that have no diagonal in a face of the cell.
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
#include "core/extract/cell_loops.h"

namespace isoscope::extract {
namespace {

// Steps 4 and 5. Returns three edges for each triangle of a loop.
std::vector<int> TriangulateLoop(int case_number, const std::vector<int>& loop) {
  const std::vector<Triangulation> candidates = TriangulationsOf(case_number, loop);
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

CaseTable MakeCaseTable() {
  CaseTable table;
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::vector<int> triangles;
    for (const std::vector<int>& loop : LoopsOf(case_number, /*joined_faces=*/0)) {
      const std::vector<int> edges = TriangulateLoop(case_number, loop);
      triangles.insert(triangles.end(), edges.begin(), edges.end());
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
