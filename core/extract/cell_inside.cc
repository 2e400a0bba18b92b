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
#include <optional>

#include "core/base/check.h"
#include "core/extract/case_table.h"
#include "core/extract/label_case_table.h"
#include "core/extract/smooth_fraction.h"
#include "core/volume/cell_samples.h"

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
double FractionOf(double a, double b, double isovalue) {
  if (std::isinf(a) != std::isinf(b)) {
    return std::isinf(a) ? 1 : 0;
  }
  return std::isinf(a) ? 0.5 : (isovalue / 2 - a / 2) / (b / 2 - a / 2);
}

// Returns t as the mesh's vertex has it, moved a little away from corners.
//
// begin: the coordinate of the lower corner
double RoundedFraction(double t, double begin) {
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

// Returns the set of inside corners; nothing if a sample is NaN.
template <typename IsInside>
std::optional<unsigned> CaseOf(const std::array<double, 8>& samples, const IsInside& is_inside) {
  unsigned inside = 0;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    if (std::isnan(samples[corner])) {
      return std::nullopt;
    }
    inside |= is_inside(samples[corner]) ? 1U << corner : 0U;
  }
  return inside;
}

// Returns true if the point is on the side of the inside corners.
//
// inside:         the set of inside corners
// triangle_count: of the case
// edges_of:       the edges of triangle i
// fraction_of:    t of the vertex on an edge
template <typename EdgesOf, typename FractionOfEdge>
bool IsOnInsideOf(unsigned inside, const math::Index3& cell, const Vec3d& position,
                  std::size_t triangle_count, const EdgesOf& edges_of,
                  const FractionOfEdge& fraction_of) {
  if (inside == 0 || inside == 0xff) {
    return inside != 0;
  }
  Vec3d from;
  for (int axis = 0; axis < 3; ++axis) {
    from[axis] = std::clamp(position[axis] - static_cast<double>(cell[axis]), kSlack, 1 - kSlack);
  }
  const Vec3d corner = CornerAt(std::countr_one(inside));
  const Vec3d to = corner + (Vec3d{0.5, 0.5, 0.5} - corner) * (2 * kCornerSlack);
  bool is_inside = false;
  for (std::size_t triangle = 0; triangle < triangle_count; ++triangle) {
    std::array<CellVertex, 3> vertices;
    const auto edges = edges_of(triangle);
    for (std::size_t i = 0; i < 3; ++i) {
      CellVertex& vertex = vertices[i];
      vertex.edge = edges[i];
      vertex.position = CornerAt(CornersOfEdge(vertex.edge).lower);
      const int axis = vertex.edge / 4;
      vertex.position[axis] =
          RoundedFraction(fraction_of(vertex.edge), static_cast<double>(cell[axis]));
    }
    is_inside ^= Crosses(from, to, vertices);
  }
  return is_inside;
}

template <typename FractionOfEdge>
bool IsInsideLabels(const std::array<double, 8>& samples, const math::Index3& cell,
                    const Vec3d& position, const volume::InsideRule& rule,
                    const FractionOfEdge& fraction_of) {
  const std::optional<unsigned> inside =
      CaseOf(samples, [&](double sample) { return rule.IsInside(sample); });
  if (!inside.has_value()) {
    return false;
  }
  const LabelCaseTable& table = GetLabelCaseTable();
  return IsOnInsideOf(
      *inside, cell, position, table.TriangleCountOf(*inside),
      [&](std::size_t triangle) { return table.EdgesOf(*inside, triangle); }, fraction_of);
}

}  // namespace

bool IsInsideCell(const std::array<double, 8>& samples, const math::Index3& cell,
                  const Vec3d& position, double isovalue) {
  const std::optional<unsigned> inside =
      CaseOf(samples, [&](double sample) { return sample >= isovalue; });
  if (!inside.has_value()) {
    return false;
  }
  const CaseTable& table = GetCaseTable();
  return IsOnInsideOf(
      *inside, cell, position, table.triangle_counts[*inside],
      [&](std::size_t triangle) { return table.edges[*inside].data() + 3 * triangle; },
      [&](int edge) {
        const EdgeCorners corners = CornersOfEdge(edge);
        return FractionOf(samples[static_cast<std::size_t>(corners.lower)],
                          samples[static_cast<std::size_t>(corners.upper)], isovalue);
      });
}

bool IsInsideCell(const std::array<double, 8>& samples, const math::Index3& cell,
                  const Vec3d& position, const volume::InsideRule& rule) {
  if (!rule.has_labels()) {
    return IsInsideCell(samples, cell, position, rule.isovalue);
  }
  ISOSCOPE_DCHECK(!rule.smooths);
  return IsInsideLabels(samples, cell, position, rule, [](int) { return 0.5; });
}

bool IsInsideSmoothCell(const volume::BlockSamples& samples, const math::IndexBox& stored,
                        const math::Index3& cell, const Vec3d& position,
                        const volume::InsideRule& rule) {
  return IsInsideLabels(
      volume::SamplesOfCell(samples, stored, cell), cell, position, rule, [&](int edge) {
        const int lower = CornersOfEdge(edge).lower;
        return SmoothFraction(samples, stored,
                              cell + math::Index3{lower & 1, lower >> 1 & 1, lower >> 2}, edge / 4);
      });
}

}  // namespace isoscope::extract
