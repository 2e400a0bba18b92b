// The point of a mesh that is nearest to a position, and the values of vertices there.

#ifndef ISOSCOPE_CORE_MESH_MESH_POINT_H_
#define ISOSCOPE_CORE_MESH_MESH_POINT_H_

#include <array>
#include <cstdint>
#include <optional>

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"

namespace isoscope::mesh {

// A point of a triangle.
struct MeshPoint {
  std::array<std::uint32_t, 3> vertices;  // of the triangle
  std::array<double, 3> weights;          // >= 0; their sum is 1
  double squared_distance = 0;            // from the position to the point

  friend bool operator==(const MeshPoint&, const MeshPoint&) = default;
};

// Returns the nearest point: of the first triangle, if several are as near. Not set: the mesh has
// no triangles. Triangles may have no area. O(triangles).
//
// position: finite, in the space of the mesh
std::optional<MeshPoint> NearestPoint(const BlockMeshView& mesh, const math::Vec3d& position);

// Mixes the values of the vertices by the weights. Vertices of weight 0 are left out, so that their
// NaN or infinity does not count. REQUIRES: the mesh has values.
double ValueAt(const VertexValues& values, const MeshPoint& point);

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_MESH_POINT_H_
