// The mesh files of an export: one for all surfaces, or one for each.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_MESH_FILES_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_MESH_FILES_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"

#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "core/math/vec.h"

namespace isoscope::cli {

// A finished file.
struct MeshFileReport {
  std::string path;
  std::int64_t vertex_count = 0;
  std::int64_t triangle_count = 0;
  std::int64_t size_bytes = 0;
};

// Opens a file when its first piece comes, and finishes it when the next one's comes: one is open
// at a time. Triangles of pieces count the vertices of their file. Thread-compatible.
class MeshFiles : public client::MeshSink {
 public:
  // files: one, of all surfaces; or one for each surface, in their order
  explicit MeshFiles(std::vector<client::MeshFileOptions> files) : files_(std::move(files)) {}

  absl::Status Add(const client::MeshPiece& piece) override;
  // Finishes all files; those of surfaces without pieces are empty meshes.
  absl::Status Finish() override;

  // True if each surface has a file of its own.
  [[nodiscard]] bool has_file_for_each() const { return files_.size() > 1; }
  // Vertices so far of the file that has a surface: those before its first one.
  [[nodiscard]] std::int64_t VertexCountBefore(int surface_index) const;
  [[nodiscard]] bool HasTriangles(int surface_index) const {
    return with_triangles_.contains(surface_index);
  }
  // The origin of the pieces so far.
  [[nodiscard]] const std::optional<math::Vec3d>& origin() const { return origin_; }
  [[nodiscard]] const std::vector<MeshFileReport>& reports() const { return reports_; }

 private:
  // Finishes the files before `file_index`, and opens that one.
  absl::Status OpenUpTo(std::size_t file_index);
  absl::Status FinishCurrent();

  const std::vector<client::MeshFileOptions> files_;
  std::unique_ptr<client::MeshWriter> writer_;  // of file reports_.size(), or null
  std::optional<math::Vec3d> origin_;
  std::set<int> with_triangles_;  // surfaces
  std::vector<MeshFileReport> reports_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_MESH_FILES_H_
