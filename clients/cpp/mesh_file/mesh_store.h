// A whole surface on disk, mapped into memory, for algorithms that need all of it.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_STORE_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_STORE_H_

#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_piece.h"
#include "core/io/file_array.h"

namespace isoscope::client {

// Takes 24 bytes of disk for each vertex and 12 for each triangle. The system decides how much of
// it is in memory. Thread-compatible.
class MeshStore : public MeshSink {
 public:
  // Unnamed scratch files lie on the file system of `directory`.
  static absl::StatusOr<std::unique_ptr<MeshStore>> Create(const std::string& directory);

  absl::Status Add(const MeshPiece& piece) override;
  absl::Status Finish() override { return absl::OkStatus(); }

  // Adds a vertex whose position and normal are the mean of those of some vertices; a copy, if
  // there is one vertex. REQUIRES: at least one.
  absl::StatusOr<std::uint32_t> AddMean(std::initializer_list<std::uint32_t> vertices);

  // Passes the mesh to `sink`, all vertices first, without those that no triangle uses; does not
  // call its Finish. The order is preserved.
  //
  // first_vertex: number of vertices of earlier surfaces in the sink
  absl::Status Emit(MeshSink* sink, std::int64_t first_vertex = 0, int surface_index = 0) const;

  [[nodiscard]] const std::string& directory() const { return directory_; }
  // The origin of positions, as MeshPiece::origin.
  [[nodiscard]] const std::optional<math::Vec3d>& origin() const { return origin_; }
  [[nodiscard]] io::FileArray<float>& positions() { return positions_; }
  [[nodiscard]] io::FileArray<std::uint32_t>& triangles() { return triangles_; }
  [[nodiscard]] std::int64_t vertex_count() const {
    return static_cast<std::int64_t>(positions_.size() / 3);
  }
  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(triangles_.size() / 3);
  }

 private:
  MeshStore(std::string directory, io::FileArray<float> positions, io::FileArray<float> normals,
            io::FileArray<std::uint32_t> triangles)
      : directory_(std::move(directory)),
        positions_(std::move(positions)),
        normals_(std::move(normals)),
        triangles_(std::move(triangles)) {}

  const std::string directory_;
  io::FileArray<float> positions_;
  io::FileArray<float> normals_;
  io::FileArray<std::uint32_t> triangles_;
  std::optional<math::Vec3d> origin_;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_STORE_H_
