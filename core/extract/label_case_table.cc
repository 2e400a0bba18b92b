// A case and its complement must have the same triangles, reversed. Two things see to that:
//
//   1. Of each ambiguous face the same diagonal is joined in both, so that the loops are the same.
//      Inside corners are joined where they lie on that diagonal.
//   2. The choice among the triangulations of a loop knows no direction. It is that of
//      case_table.cc up to ties: least difference of directions, then a volume near the middle.
//      Among those that are equal in both, the smallest list of diagonals is taken, each diagonal
//      its lower edge first, the list in ascending order.
//
// By this rule every loop has a triangulation without a diagonal in a face of the cell. That is
// not so for all ways of joining: if the two ambiguous faces of case 60 (corners 2, 3, 4 and 5)
// were joined differently, their loop of eight edges would have none. So which diagonal is joined
// can't depend on the labels at its ends. Nor can it be the other diagonal of all faces: then 14
// cases have none.
//
// Example: case 9 has corners 0 and 3 inside, the diagonal of face z = 0 with the lowest corner. So
// they are separated, two triangles. Case 6 has corners 1 and 2, the other diagonal: joined, one
// loop of six edges.

#include "core/extract/label_case_table.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "core/extract/cell_loops.h"

namespace isoscope::extract {
namespace {

// Returns the set of ambiguous faces whose inside corners are joined.
unsigned JoinedFacesOf(int case_number) {
  unsigned joined = 0;
  for (int face = 0; face < kFaceCount; ++face) {
    const std::array<int, 4> corners = CornersOfFace(face);
    const int lowest = *std::min_element(corners.begin(), corners.end());
    joined |= (case_number >> lowest & 1) == 0 ? 1U << face : 0U;
  }
  return joined & AmbiguousFacesOf(case_number);
}

// Returns the diagonals of a loop's triangulation, each its lower edge first, ascending.
std::vector<std::pair<int, int>> DiagonalsOf(const std::vector<int>& loop,
                                             const Triangulation& triangulation) {
  const auto is_side = [&](int a, int b) {
    for (std::size_t i = 0; i < loop.size(); ++i) {
      if (loop[i] == a && loop[(i + 1) % loop.size()] == b) {
        return true;
      }
    }
    return false;
  };
  std::vector<std::pair<int, int>> diagonals;
  for (std::size_t i = 0; i < triangulation.edges.size(); ++i) {
    const std::size_t following = i % 3 == 2 ? i - 2 : i + 1;
    const int a = triangulation.edges[i];
    const int b = triangulation.edges[following];
    // Both triangles of a diagonal have it, in opposite directions.
    if (a < b && !is_side(a, b) && !is_side(b, a)) {
      diagonals.emplace_back(a, b);
    }
  }
  std::sort(diagonals.begin(), diagonals.end());
  return diagonals;
}

// Returns three edges for each triangle of a loop.
std::vector<int> TriangulateLoopOfLabels(int case_number, const std::vector<int>& loop) {
  const std::vector<Triangulation> candidates = TriangulationsOf(case_number, loop);
  ISOSCOPE_CHECK(!candidates.empty());
  const auto [least, most] = std::minmax_element(
      candidates.begin(), candidates.end(),
      [](const Triangulation& a, const Triangulation& b) { return a.volume < b.volume; });
  const int twice_middle_volume = least->volume + most->volume;
  const auto rank = [&](const Triangulation& candidate) {
    return std::tuple(candidate.direction_difference,
                      std::abs(2 * candidate.volume - twice_middle_volume),
                      DiagonalsOf(loop, candidate));
  };
  return std::min_element(
             candidates.begin(), candidates.end(),
             [&](const Triangulation& a, const Triangulation& b) { return rank(a) < rank(b); })
      ->edges;
}

std::uint8_t LaneOf(int edge) {
  return static_cast<std::uint8_t>(4 * CornersOfEdge(edge).lower + edge / 4);
}

LabelCaseTable MakeLabelCaseTable() {
  LabelCaseTable table;
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::vector<int> triangles;
    for (const std::vector<int>& loop : LoopsOf(case_number, JoinedFacesOf(case_number))) {
      const std::vector<int> edges = TriangulateLoopOfLabels(case_number, loop);
      triangles.insert(triangles.end(), edges.begin(), edges.end());
    }
    ISOSCOPE_CHECK_LE(triangles.size(), 3 * std::size_t{kMaxLabelTrianglesPerCell});
    const auto row = static_cast<std::size_t>(case_number);
    constexpr std::size_t kFirst = 3 * std::size_t{kMaxTrianglesPerCell};
    const std::size_t first_count = std::min(triangles.size(), kFirst);
    table.first_triangles.triangle_counts[row] = static_cast<std::uint8_t>(first_count / 3);
    table.has_last[row] = triangles.size() > kFirst;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      const auto edge = static_cast<std::uint8_t>(triangles[i]);
      if (i < kFirst) {
        table.first_triangles.edges[row][i] = edge;
        table.first_triangles.lanes[row][i] = LaneOf(triangles[i]);
      } else {
        table.last_edges[row][i - kFirst] = edge;
        table.last_lanes[row][i - kFirst] = LaneOf(triangles[i]);
      }
    }
  }
  return table;
}

}  // namespace

const LabelCaseTable& GetLabelCaseTable() {
  static const LabelCaseTable table = MakeLabelCaseTable();
  return table;
}

}  // namespace isoscope::extract
