// Polygons of a solid, cut by half-spaces and split into triangles.

#ifndef ISOSCOPE_CORE_SOLID_POLYGON_CUTTER_H_
#define ISOSCOPE_CORE_SOLID_POLYGON_CUTTER_H_

#include <array>
#include <cstddef>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "absl/functional/function_ref.h"

#include "core/math/vec.h"
#include "core/solid/vertex_pool.h"
#include "core/view/clip_region.h"

namespace isoscope::solid {

// The corners of a polygon, in order.
using Points = absl::InlinedVector<VertexId, 8>;
using Corners = std::array<VertexId, 3>;

// A side of a cut polygon that lies on the border of the half-space, in the polygon's direction.
struct PlaneSide {
  VertexId from = 0;
  VertexId to = 0;
};

// A half-space that cuts.
struct Cut {
  const view::HalfSpace* half_space = nullptr;
  int rank = 1;  // of the half-space, from 1
  // What a corner on the border is. kInside: as one that lies a little inside, so that every edge
  // that leaves the half-space gets a vertex. The cut of a closed solid is closed then, with parts
  // that have no area. kBorder: a part that only touches the border is dropped, a corner stays as
  // it is.
  enum class OnBorder { kInside, kBorder };
  OnBorder on_border = OnBorder::kBorder;
};

// Cuts a polygon (Sutherland and Hodgman 1974). A polygon whose border crosses the half-space's
// more than twice is cut in triangles around its first corner.
//
// kept:  appended to: what is inside; the first point is the polygon's first one that is kept, or
//        the one after it
// sides: appended to
void CutPolygon(const Points& polygon, const Cut& cut, VertexPool* pool, std::vector<Points>* kept,
                std::vector<PlaneSide>* sides);

// Links sides to polygons that run against them: the faces that close a cut. REQUIRES: each vertex
// begins as many sides as it ends, at most one.
std::vector<Points> LinkSides(std::vector<PlaneSide> sides);

// Splits a polygon of `size` points into triangles, so that the least of their qualities is as
// large as possible. Of equal choices the first is taken. Returns three points for each. O(size^3).
std::vector<std::array<std::size_t, 3>> SplitByQuality(
    std::size_t size, absl::FunctionRef<double(std::size_t, std::size_t, std::size_t)> quality);

// The shape of a triangle: 2 * area / (longest side)^2, negative if it is turned over.
//
// outward: it is counter-clockwise seen from there
double ShapeOf(const std::array<math::Vec3d, 3>& corners, const math::Vec3d& outward);

// Splits a polygon by the shapes of triangles; those with coinciding corners do not count.
//
// outward:   index space
// triangles: appended to
void SplitPolygon(const Points& polygon, const math::Vec3d& outward, const VertexPool& pool,
                  std::vector<Corners>* triangles);

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_POLYGON_CUTTER_H_
