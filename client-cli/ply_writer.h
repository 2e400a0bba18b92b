// Writes a mesh of unknown size as a binary little-endian PLY file: vertices with x y z nx ny nz
// (float), faces with a list of three int vertex_indices.
//
// Vertices go straight behind a header of fixed length, faces into a second file that is joined at
// the end, when the counts are known; so memory stays small whatever the mesh's size.

#ifndef ISOSCOPE_CLIENT_CLI_PLY_WRITER_H_
#define ISOSCOPE_CLIENT_CLI_PLY_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"

namespace isoscope::cli {

// Create, then AddChunk for every chunk, then Finish. Without Finish the destructor removes the
// files written so far. Thread-compatible.
class PlyWriter {
 public:
  // The limit of the format's 32-bit vertex indices.
  static constexpr std::int64_t kMaxVertexCount = 0x7fffffff;

  // `path` appears at Finish, in one step. Errors as io::CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<PlyWriter>> Create(const std::string& path);
  ~PlyWriter();
  PlyWriter(const PlyWriter&) = delete;
  PlyWriter& operator=(const PlyWriter&) = delete;

  // positions, normals: x, y, z of the new vertices, little-endian float32, as many of one as of
  // the other. triangles: three vertex indices each, counted over all chunks, little-endian int64,
  // each below the count of vertices so far, these included.
  // DATA_LOSS if the bytes are not that; OUT_OF_RANGE above kMaxVertexCount vertices.
  absl::Status AddChunk(absl::string_view positions, absl::string_view normals,
                        absl::string_view triangles);

  absl::Status Finish();

  [[nodiscard]] std::int64_t vertex_count() const { return vertex_count_; }
  [[nodiscard]] std::int64_t triangle_count() const { return triangle_count_; }
  // Of the file, once finished.
  [[nodiscard]] std::int64_t size_bytes() const { return vertices_file_->size_bytes(); }

 private:
  explicit PlyWriter(const std::string& path);

  absl::Status AppendFaces();

  const std::string path_;
  const std::string vertices_path_;  // becomes the file
  const std::string faces_path_;
  std::unique_ptr<io::WritableFile> vertices_file_;
  std::unique_ptr<io::WritableFile> faces_file_;
  std::int64_t vertex_count_ = 0;
  std::int64_t triangle_count_ = 0;
};

// The header for these counts: always the same length.
std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_PLY_WRITER_H_
