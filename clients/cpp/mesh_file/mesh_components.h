// Connected components of a mesh: parts that share no vertex.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_COMPONENTS_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_COMPONENTS_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_store.h"

namespace isoscope::client {

struct DroppedComponents {
  std::int64_t component_count = 0;  // of all
  std::int64_t dropped_count = 0;    // removed ones
  std::int64_t dropped_triangle_count = 0;
};

// Removes the triangles of all components that have fewer than `min_triangles`; the others keep
// their order. Two triangles belong to one component if they share a vertex, or if a chain of such
// triangles connects them. Takes 8 bytes of disk for each vertex besides.
absl::StatusOr<DroppedComponents> DropSmallComponents(std::int64_t min_triangles, MeshStore* mesh);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_COMPONENTS_H_
