// Area, enclosed volume and openness of a surface.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_MEASURES_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_MEASURES_H_

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_store.h"

namespace isoscope::client {

struct SurfaceMeasures {
  double area = 0;                              // world units squared
  std::optional<double> volume = std::nullopt;  // world units cubed; not set: the surface is open
  std::int64_t triangle_count = 0;
  std::int64_t open_edge_count = 0;  // edges with fewer triangles on one side than on the other

  friend bool operator==(const SurfaceMeasures&, const SurfaceMeasures&) = default;
};

// Measures a mesh. The sums are exact and rounded once, so the order of triangles does not show.
// Takes 24 bytes of disk for each triangle besides. Errors of scratch files.
absl::StatusOr<SurfaceMeasures> MeasureMesh(MeshStore* mesh);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_MEASURES_H_
