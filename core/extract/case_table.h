// The marching cubes table: for each case of a cell, the grid edges that its triangles join.
//
// Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2 & 1) from its lowest sample. Bit c of a
// case number is set iff corner c is inside. Edge 4 * axis + k runs along `axis`; the low bit of k
// is the offset on the lower of the other two axes, the high bit on the higher.
//
// The table is generated from one rule (docs/numerics.md, "Case table"). Meshes of neighbouring
// cells fit without cracks, because the segments on a face depend on the four signs of that face
// alone.

#ifndef ISOSCOPE_CORE_EXTRACT_CASE_TABLE_H_
#define ISOSCOPE_CORE_EXTRACT_CASE_TABLE_H_

#include <array>
#include <cstdint>

namespace isoscope::extract {

inline constexpr int kMaxTrianglesPerCell = 5;

// The two corners of an edge, the lower one first.
struct EdgeCorners {
  int lower = 0;
  int upper = 0;
};
constexpr EdgeCorners CornersOfEdge(int edge) {
  const int axis = edge / 4;
  const int k = edge % 4;
  const int low_axis = axis == 0 ? 1 : 0;
  const int high_axis = axis == 2 ? 1 : 2;
  const int lower = (k & 1) << low_axis | (k >> 1) << high_axis;
  return {lower, lower | 1 << axis};
}

// Immutable; thread-safe.
struct CaseTable {
  std::array<std::uint8_t, 256> triangle_counts{};
  // By case: three edges for each triangle, counter-clockwise seen from outside; the rest is 0.
  std::array<std::array<std::uint8_t, 16>, 256> edges{};
  // The same triangles, each edge as its lane: 4 * (its lower corner) + axis.
  std::array<std::array<std::uint8_t, 16>, 256> lanes{};
};

// Returns the table, which is made on first use. Thread-safe.
const CaseTable& GetCaseTable();

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_CASE_TABLE_H_
