// Makes a mesh whose parts touch along edges one in which each edge has two triangles.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_REPAIR_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_REPAIR_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_store.h"

namespace isoscope::client {

// Simplification may bring several parts of a surface to one edge. Each such edge is shared out
// among pairs of triangles; its ends become several vertices where that tells the pairs apart, else
// an edge gets a vertex in its middle. No vertex moves; area and volume stay. Edges that have fewer
// triangles on one side than on the other stay open. Takes 24 bytes of disk for each triangle
// besides.
//
// Two triangles back to back that hang on such an edge are opened before that, if their third
// vertex lies near the edge: it becomes a vertex of the edge. That moves the surface towards the
// vertex, by its distance from the edge.
//
// Returns the number of edges that had more than two triangles.
absl::StatusOr<std::int64_t> SeparateTouchingParts(MeshStore* mesh);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_REPAIR_H_
