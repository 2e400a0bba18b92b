// The triangles of a cell split it into parts that are alternately inside and outside. So the point
// is inside iff the segment from it to an outside corner crosses an odd number of triangles.
//
// Signs of volumes decide whether a segment passes a triangle. For an edge that two triangles
// share, both use the same end. So exactly one of the two is hit. The point, the corner and the
// vertices are moved a little, so that the segment can pass exactly through an edge only.

#include "core/extract/cell_inside.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/extract/case_table.h"

namespace isoscope::extract {
namespace {

using math::Vec3d;

constexpr double kSlack = 1e-6;
// The corner moves less than the vertices next to it, so that it stays outside.
constexpr double kCornerSlack = 1e-7;

Vec3d CornerAt(int corner) {
  return {static_cast<double>(corner & 1), static_cast<double>(corner >> 1 & 1),
          static_cast<double>(corner >> 2)};
}

// Returns the position of the vertex on an edge, from the lower corner: docs/numerics.md, "Vertex
// position".
//
// begin: the coordinate of the lower corner
double ShareOf(double a, double b, double isovalue, double begin) {
  double t = 0.5;
  if (std::isinf(a) != std::isinf(b)) {
    t = std::isinf(a) ? 1 : 0;
  } else if (!std::isinf(a)) {
    t = (isovalue / 2 - a / 2) / (b / 2 - a / 2);
  }
  const double rounded = static_cast<double>(static_cast<float>(begin + t)) - begin;
  return std::clamp(rounded, kSlack, 1 - kSlack);
}

// Six times the signed volume of a tetrahedron.
double Volume(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  return math::Dot(b - a, math::Cross(c - a, d - a));
}

struct CellVertex {
  int edge = 0;
  Vec3d position;
};

// Returns the side of edge p q that the line a b passes on, seen from the end with the lower
// number.
bool PassesLeft(const Vec3d& a, const Vec3d& b, const CellVertex& p, const CellVertex& q) {
  return p.edge < q.edge ? Volume(a, b, p.position, q.position) >= 0
                         : !(Volume(a, b, q.position, p.position) >= 0);
}

bool Crosses(const Vec3d& a, const Vec3d& b, const std::array<CellVertex, 3>& v) {
  const bool is_left = PassesLeft(a, b, v[0], v[1]);
  if (is_left != PassesLeft(a, b, v[1], v[2]) || is_left != PassesLeft(a, b, v[2], v[0])) {
    return false;
  }
  return (Volume(v[0].position, v[1].position, v[2].position, a) >= 0) !=
         (Volume(v[0].position, v[1].position, v[2].position, b) >= 0);
}

}  // namespace

bool IsInsideCell(const std::array<double, 8>& samples, const math::Index3& cell,
                  const Vec3d& position, double isovalue) {
  unsigned inside = 0;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    if (std::isnan(samples[corner])) {
      return false;
    }
    inside |= samples[corner] >= isovalue ? 1U << corner : 0U;
  }
  if (inside == 0 || inside == 0xff) {
    return inside != 0;
  }
  Vec3d from;
  for (int axis = 0; axis < 3; ++axis) {
    from[axis] = std::clamp(position[axis] - static_cast<double>(cell[axis]), kSlack, 1 - kSlack);
  }
  const Vec3d corner = CornerAt(std::countr_one(inside));
  const Vec3d to = corner + (Vec3d{0.5, 0.5, 0.5} - corner) * (2 * kCornerSlack);

  const CaseTable& table = GetCaseTable();
  bool is_inside = false;
  for (std::size_t triangle = 0; triangle < table.triangle_counts[inside]; ++triangle) {
    std::array<CellVertex, 3> vertices;
    for (std::size_t i = 0; i < 3; ++i) {
      CellVertex& vertex = vertices[i];
      vertex.edge = table.edges[inside][3 * triangle + i];
      const auto [lower, upper] = CornersOfEdge(vertex.edge);
      vertex.position = CornerAt(lower);
      const int axis = vertex.edge / 4;
      vertex.position[axis] = ShareOf(samples[static_cast<std::size_t>(lower)],
                                      samples[static_cast<std::size_t>(upper)], isovalue,
                                      static_cast<double>(cell[axis]));
    }
    is_inside ^= Crosses(from, to, vertices);
  }
  return is_inside;
}

}  // namespace isoscope::extract
