// CutPolygon:
//
//   1. Compute the distances of the corners. A polygon inside is kept, one outside is dropped.
//   2. If the border of the half-space crosses the polygon at most twice, CutOnce keeps the corners
//      inside and puts a vertex on each crossed edge.
//   3. Else the polygon is cut as a fan of triangles, each of which is crossed at most twice.
//
// SplitByQuality finds the triangulation whose worst triangle is best, by dynamic programming: the
// best split of the points i to j is a triangle (i, k, j) and the best splits of i to k and k to j.
// O(n^3) for n points; polygons of a cell have few.
//
// Invariant: vertices are in the pool once, so polygons that share a crossed edge share the vertex.

#include "core/solid/polygon_cutter.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/base/check.h"
#include "core/math/vec_conversion.h"

namespace isoscope::solid {
namespace {

using Distances = absl::InlinedVector<double, 8>;

math::Vec3d PositionOf(VertexId id, const VertexPool& pool) {
  return math::DoubleOf(pool[id].position);
}

// Whether the edge between two corners gets a vertex.
bool IsCrossed(double from, double to, Cut::OnBorder on_border) {
  if (on_border == Cut::OnBorder::kInside) {
    return (from >= 0) != (to >= 0);
  }
  return (from > 0 && to < 0) || (from < 0 && to > 0);
}

// Cuts a polygon whose border crosses that of the half-space at most twice.
void CutOnce(const Points& polygon, const Distances& distances, const Cut& cut, VertexPool* pool,
             std::vector<Points>* kept, std::vector<PlaneSide>* sides) {
  Points points;
  PlaneSide side;
  bool has_side = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const std::size_t next = (i + 1) % polygon.size();
    if (distances[i] >= 0) {
      points.push_back(polygon[i]);
    }
    if (!IsCrossed(distances[i], distances[next], cut.on_border)) {
      continue;
    }
    has_side = true;
    if (distances[i] >= 0) {
      side.from = pool->OnCut(polygon[i], polygon[next], *cut.half_space, cut.rank);
      points.push_back(side.from);
    } else {
      side.to = pool->OnCut(polygon[next], polygon[i], *cut.half_space, cut.rank);
      points.push_back(side.to);
    }
  }
  kept->push_back(std::move(points));
  if (has_side) {
    sides->push_back(side);
  }
}

}  // namespace

void CutPolygon(const Points& polygon, const Cut& cut, VertexPool* pool, std::vector<Points>* kept,
                std::vector<PlaneSide>* sides) {
  Distances distances;
  for (const VertexId id : polygon) {
    distances.push_back(view::Clipper::DistanceOf(*cut.half_space, (*pool)[id].position));
  }
  if (std::all_of(distances.begin(), distances.end(), [](double d) { return d >= 0; })) {
    kept->push_back(polygon);
    return;
  }
  const bool borders_count = cut.on_border == Cut::OnBorder::kInside;
  if (std::none_of(distances.begin(), distances.end(),
                   [&](double d) { return borders_count ? d >= 0 : d > 0; })) {
    return;
  }
  int crossings = 0;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    crossings +=
        IsCrossed(distances[i], distances[(i + 1) % distances.size()], cut.on_border) ? 1 : 0;
  }
  if (crossings <= 2) {
    CutOnce(polygon, distances, cut, pool, kept, sides);
    return;
  }
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    CutPolygon({polygon[0], polygon[i - 1], polygon[i]}, cut, pool, kept, sides);
  }
}

std::vector<Points> LinkSides(std::vector<PlaneSide> sides) {
  std::vector<Points> polygons;
  while (!sides.empty()) {
    // Against a side: from its end to its start.
    Points polygon{sides.front().to};
    VertexId at = sides.front().from;
    sides.erase(sides.begin());
    while (at != polygon.front()) {
      polygon.push_back(at);
      const auto next = std::find_if(sides.begin(), sides.end(),
                                     [&](const PlaneSide& side) { return side.to == at; });
      ISOSCOPE_CHECK(next != sides.end());
      at = next->from;
      sides.erase(next);
    }
    polygons.push_back(std::move(polygon));
  }
  return polygons;
}

std::vector<std::array<std::size_t, 3>> SplitByQuality(
    std::size_t size, absl::FunctionRef<double(std::size_t, std::size_t, std::size_t)> quality) {
  std::vector<std::array<std::size_t, 3>> triangles;
  if (size < 3) {
    return triangles;
  }
  // best[i * size + j]: of the points i to j; middle: the third corner of the triangle on (i, j).
  std::vector<double> best(size * size, std::numeric_limits<double>::infinity());
  std::vector<std::size_t> middle(size * size, 0);
  for (std::size_t length = 2; length < size; ++length) {
    for (std::size_t i = 0; i + length < size; ++i) {
      const std::size_t j = i + length;
      for (std::size_t k = i + 1; k < j; ++k) {
        const double worst = std::min({best[i * size + k], best[k * size + j], quality(i, k, j)});
        if (k == i + 1 || worst > best[i * size + j]) {
          best[i * size + j] = worst;
          middle[i * size + j] = k;
        }
      }
    }
  }
  std::vector<std::pair<std::size_t, std::size_t>> open{{0, size - 1}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (j - i < 2) {
      continue;
    }
    const std::size_t k = middle[i * size + j];
    triangles.push_back({i, k, j});
    open.emplace_back(k, j);
    open.emplace_back(i, k);
  }
  return triangles;
}

double ShapeOf(const std::array<math::Vec3d, 3>& corners, const math::Vec3d& outward) {
  const auto& [a, b, c] = corners;
  const double longest =
      std::max({math::Dot(b - a, b - a), math::Dot(c - b, c - b), math::Dot(a - c, a - c)});
  return longest > 0 ? math::Dot(math::Cross(b - a, c - a), outward) / longest : 0;
}

void SplitPolygon(const Points& polygon, const math::Vec3d& outward, const VertexPool& pool,
                  std::vector<Corners>* triangles) {
  const auto quality = [&](std::size_t i, std::size_t k, std::size_t j) {
    const VertexId a = polygon[i];
    const VertexId b = polygon[k];
    const VertexId c = polygon[j];
    return pool.Coincide(a, b) || pool.Coincide(b, c) || pool.Coincide(c, a)
               ? std::numeric_limits<double>::infinity()
               : ShapeOf({PositionOf(a, pool), PositionOf(b, pool), PositionOf(c, pool)}, outward);
  };
  for (const auto& [i, k, j] : SplitByQuality(polygon.size(), quality)) {
    triangles->push_back({polygon[i], polygon[k], polygon[j]});
  }
}

}  // namespace isoscope::solid
