// Binary little-endian PLY. Vertices have x y z nx ny nz (float; x y z double where the mesh has an
// origin), with colours red green blue (uchar), and with several surfaces surface_index (uchar; int
// of more than 256). Faces have a list of three int vertex_indices.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for PLY.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreatePly(const MeshFileOptions& options);

// The properties of the vertices of a file.
struct PlyVertex {
  bool has_doubles = false;  // x, y, z
  bool has_colors = false;
  bool has_surface_index = false;
  bool has_wide_index = false;  // int
};

// Returns the header for these counts; its length does not depend on them. Each of `comments` is a
// line.
std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count,
                          const PlyVertex& vertex = {},
                          const std::vector<std::string>& comments = {});

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_
