// Meshes that pass through in pieces, so that none needs to fit into memory.

#ifndef ISOSCOPE_CLIENT_CLI_MESH_PIECE_H_
#define ISOSCOPE_CLIENT_CLI_MESH_PIECE_H_

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// The limit of 32-bit vertex indices with a sign, which PLY and VTP have.
inline constexpr std::int64_t kMaxVertexCount = 0x7fffffff;

// New vertices and new triangles of a welded mesh.
struct MeshPiece {
  std::vector<float> positions;          // x, y, z of each vertex
  std::vector<float> normals;            // as many
  std::vector<std::uint32_t> triangles;  // three vertex indices each, counted over all pieces

  [[nodiscard]] std::int64_t vertex_count() const {
    return static_cast<std::int64_t>(positions.size() / 3);
  }
  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(triangles.size() / 3);
  }
};

// Decodes a message of ExportIsosurface.
//
// positions, normals: x, y, z of the new vertices, little-endian float32, as many of one as of
//                     the other
// triangles:          three vertex indices each, little-endian int64, each below the count of
//                     vertices so far, these included
// vertex_count:       of all pieces before
//
// DATA_LOSS if the bytes are not that; OUT_OF_RANGE above kMaxVertexCount vertices.
absl::StatusOr<MeshPiece> DecodeMeshPiece(absl::string_view positions, absl::string_view normals,
                                          absl::string_view triangles, std::int64_t vertex_count);

// Takes a mesh in pieces: a triangle has only vertices of its own and of earlier pieces.
// Add for every piece, then Finish once. Thread-compatible.
class MeshSink {
 public:
  virtual ~MeshSink() = default;

  virtual absl::Status Add(const MeshPiece& piece) = 0;
  virtual absl::Status Finish() = 0;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_MESH_PIECE_H_
