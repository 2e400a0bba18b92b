// Fewer triangles for nearly the same surface, by libmeshoptimizer.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_SIMPLIFIER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_SIMPLIFIER_H_

#include <cstdint>
#include <functional>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_store.h"

namespace isoscope::client {

struct SimplifyOptions {
  std::optional<double> share = std::nullopt;  // of the triangles to keep, in (0, 1)
  std::optional<double> max_error =
      std::nullopt;  // world units, > 0: as libmeshoptimizer estimates it
  // Triangles that are simplified together: bounds the memory, some 200 bytes a triangle.
  std::int64_t part_triangle_count = std::int64_t{1} << 20;
  // Called between parts, 0 to 1; an error ends the work and is returned. May be null.
  std::function<absl::Status(double done)> progress = nullptr;
};

struct SimplifyResult {
  std::int64_t triangle_count = 0;  // that remain
  double error = 0;                 // world units, estimated: the sum over the rounds
};

// Removes triangles until `share` of them is left, or until the next removal would move the surface
// by more than `max_error`, whichever is first. Remaining vertices keep their positions and
// normals. A closed surface stays closed: each edge has two triangles (mesh_repair.h).
//
// A mesh of more than part_triangle_count triangles is processed in parts, in the order of the
// stream. Vertices that parts share are kept, so there are no cracks. A second and a third round
// have other borders between parts, and so simplify the earlier ones. Deterministic. REQUIRES: one
// of share and max_error.
absl::StatusOr<SimplifyResult> SimplifyMesh(const SimplifyOptions& options, MeshStore* mesh);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_SIMPLIFIER_H_
