// Meshes as streams of pieces, so that no mesh has to fit into memory.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_PIECE_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_PIECE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"

namespace isoscope::client {

// The limit of signed 32-bit vertex indices, which PLY and VTP use.
inline constexpr std::int64_t kMaxVertexCount = 0x7fffffff;

// New vertices and new triangles of a mesh, all of one surface.
struct MeshPiece {
  std::vector<float> positions = {};          // x, y, z of each vertex, from the origin
  std::vector<float> normals = {};            // as many
  std::vector<std::uint32_t> triangles = {};  // three vertex indices each, counted over all pieces
  int surface_index = 0;                      // never falls from piece to piece
  // World position that positions are from, the same in all pieces of a mesh. Not set: (0, 0, 0).
  // Set where float32 can't tell world positions apart (docs/export.md, "Far from the origin").
  std::optional<math::Vec3d> origin = std::nullopt;

  [[nodiscard]] std::int64_t vertex_count() const {
    return static_cast<std::int64_t>(positions.size() / 3);
  }
  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(triangles.size() / 3);
  }
};

// Returns "500000 4600000 100".
std::string TextOfOrigin(const math::Vec3d& origin);

// Decodes the messages of ExportIsosurface, in their order. Thread-compatible.
class MeshDecoder {
 public:
  explicit MeshDecoder(int surface_count) : surface_count_(surface_count) {}

  // positions, normals: x, y, z of the new vertices, little-endian float32, as many of one as of
  //                     the other
  // triangles:          three vertex indices each, little-endian int64, each of a vertex of this
  //                     surface, in this message or before
  //
  // origin:             of positions; not set: (0, 0, 0)
  //
  // DATA_LOSS if the bytes have another form, if the surface is not in the request or precedes the
  // last one, or if the origin is not that of the first message. OUT_OF_RANGE above kMaxVertexCount
  // vertices.
  absl::StatusOr<MeshPiece> Decode(int surface_index, absl::string_view positions,
                                   absl::string_view normals, absl::string_view triangles,
                                   const std::optional<math::Vec3d>& origin = std::nullopt);

  // Vertices of all surfaces so far.
  [[nodiscard]] std::int64_t vertex_count() const { return vertex_count_; }
  [[nodiscard]] std::int64_t triangle_count() const { return triangle_count_; }

 private:
  const int surface_count_;
  int surface_index_ = 0;
  std::int64_t first_vertex_ = 0;  // of the surface
  std::int64_t vertex_count_ = 0;
  std::int64_t triangle_count_ = 0;
  std::optional<math::Vec3d> origin_;
  bool has_begun_ = false;
};

// Decodes one message.
//
// positions, normals: x, y, z of the new vertices, little-endian float32, as many of one as of
//                     the other
// triangles:          three vertex indices each, little-endian int64, each at least first_vertex
//                     and below the count of vertices so far, these included
// vertex_count:       of all pieces before
// first_vertex:       of the surface
//
// DATA_LOSS if the bytes have another form; OUT_OF_RANGE above kMaxVertexCount vertices.
absl::StatusOr<MeshPiece> DecodeMeshPiece(absl::string_view positions, absl::string_view normals,
                                          absl::string_view triangles, std::int64_t vertex_count,
                                          std::int64_t first_vertex = 0);

// Receives a mesh in pieces: a triangle has only vertices of its own and of earlier pieces. Call
// Add for every piece, then Finish once. Thread-compatible.
class MeshSink {
 public:
  virtual ~MeshSink() = default;

  virtual absl::Status Add(const MeshPiece& piece) = 0;
  virtual absl::Status Finish() = 0;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_PIECE_H_
