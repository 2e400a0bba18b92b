// The boundary of the surface in one cell, as loops over the cell's edges, and the triangulations
// of a loop. The tables of isovalues (case_table.h) and of labels (label_table.h) are made of them.
//
// Corners, edges and case numbers are those of case_table.h. Face 2 * axis + side is the one whose
// corners have `side`, 0 or 1, on `axis`. A set of faces has bit f for face f.
//
// A face is ambiguous if two diagonal corners are inside and two are outside. It has two segments:
// they cut off each inside corner, or, where the face is joined, each outside corner.

#ifndef ISOSCOPE_CORE_EXTRACT_CELL_LOOPS_H_
#define ISOSCOPE_CORE_EXTRACT_CELL_LOOPS_H_

#include <array>
#include <vector>

namespace isoscope::extract {

inline constexpr int kFaceCount = 6;

// Returns the corners of a face, counter-clockwise seen from outside the cell.
std::array<int, 4> CornersOfFace(int face);

// Returns the set of the case's ambiguous faces.
unsigned AmbiguousFacesOf(int case_number);

// Returns the loops of a case: edges in the order of triangles that are counter-clockwise seen from
// outside the solid. Each starts at its lowest edge, and so are they ordered.
//
// joined_faces: a set; only those that are ambiguous count
std::vector<std::vector<int>> LoopsOf(int case_number, unsigned joined_faces);

struct Triangulation {
  std::vector<int> edges;        // three for each triangle
  int direction_difference = 0;  // 1 - cos of the angle between the edges, summed over diagonals
  int volume = 0;                // 48 times that below the triangles, between middles of edges
};

// Returns all triangulations of a loop without a diagonal in a face of the cell.
std::vector<Triangulation> TriangulationsOf(int case_number, const std::vector<int>& loop);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_CELL_LOOPS_H_
