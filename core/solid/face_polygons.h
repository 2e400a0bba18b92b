// The inside part of a face of a cell: one or two polygons, between the face's inside corners and
// the vertices on its crossed edges. The sides between two such vertices are the segments that the
// triangles of both cells have (docs/numerics.md, "Case table" and "Labels").
//
// Face corners 0 to 3 are numbered counter-clockwise seen from the end of its axis, from the lowest
// on: 0, +u, +u+v, +v with u = axis + 1 and v = axis + 2 mod 3. Face edge i is the one from corner
// i to corner i + 1.

#ifndef ISOSCOPE_CORE_SOLID_FACE_POLYGONS_H_
#define ISOSCOPE_CORE_SOLID_FACE_POLYGONS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/math/vec.h"

namespace isoscope::solid {

// Face 2 * axis + side of a cell has the corners with `side`, 0 or 1, on `axis`.
inline constexpr std::size_t kFaceCount = 6;
constexpr math::Index3 CellBehind(math::Index3 cell, std::size_t face) {
  cell[static_cast<int>(face / 2)] += face % 2 == 0 ? -1 : 1;
  return cell;
}
// Index space.
constexpr math::Vec3d OutwardOf(std::size_t face) {
  math::Vec3d outward;
  outward[static_cast<int>(face / 2)] = face % 2 == 0 ? -1 : 1;
  return outward;
}

// Convex; counter-clockwise seen from the end of the axis.
struct FacePolygon {
  static constexpr std::uint8_t kFirstEdge = 4;

  std::size_t size = 0;
  std::array<std::uint8_t, 6> points{};  // corner i as i, the vertex on edge i as kFirstEdge + i
};

struct FacePolygons {
  std::size_t count = 0;
  std::array<FacePolygon, 2> polygons;
};

// inside:     bit i is set iff corner i is inside
// has_labels: whether the rule for ambiguous faces is that of labels
//
// Immutable; thread-safe. REQUIRES: inside < 16.
const FacePolygons& FacePolygonsOf(unsigned inside, bool has_labels);

// Returns the inside corners of a face, from those of the cell (extract/case_table.h).
unsigned InsideOfFace(unsigned cell_case, std::size_t face);

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_FACE_POLYGONS_H_
