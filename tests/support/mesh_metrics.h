// Figures of a whole surface: area, volume and whether it is sound. For tests and `export`.

#ifndef ISOSCOPE_TESTS_SUPPORT_MESH_METRICS_H_
#define ISOSCOPE_TESTS_SUPPORT_MESH_METRICS_H_

#include <cstdint>
#include <span>
#include <vector>

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::testing {

// A mesh in which every vertex appears once.
struct WeldedMesh {
  std::vector<math::Vec3f> positions;   // in index space (samples)
  std::vector<math::Vec3f> normals;     // one for each position, world space
  std::vector<std::int64_t> triangles;  // three positions for each
};

// Welds blocks: those with edge keys by these, others as MeshWelder does.
// REQUIRES: all or none have edge keys; as MeshWelder::Add says.
WeldedMesh Weld(const volume::BlockLayout& layout, std::span<const mesh::BlockMesh> blocks);

struct MeshMetrics {
  std::int64_t vertex_count = 0;  // that some triangle uses
  std::int64_t triangle_count = 0;
  std::int64_t edge_count = 0;
  std::int64_t boundary_edge_count = 0;      // with one triangle
  std::int64_t non_manifold_edge_count = 0;  // with three or more
  // With two triangles that run along it in the same direction.
  std::int64_t inconsistent_edge_count = 0;
  std::int64_t degenerate_triangle_count = 0;  // of zero area in index space
  double area = 0;                             // world units squared
  // World units cubed; > 0 if a closed surface encloses what is inside. Means nothing for a surface
  // with a boundary.
  double volume = 0;

  // Vertices - edges + triangles: 2 for each sphere, 0 for each torus of a closed surface.
  [[nodiscard]] std::int64_t euler_characteristic() const {
    return vertex_count - edge_count + triangle_count;
  }
};

// REQUIRES: fewer than 2^31 positions. O(triangles log triangles) time, 24 bytes a triangle.
MeshMetrics Measure(const WeldedMesh& mesh, const volume::GridGeometry& geometry);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MESH_METRICS_H_
