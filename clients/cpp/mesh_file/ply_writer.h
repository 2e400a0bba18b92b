// Binary little-endian PLY. Vertices have x y z nx ny nz (float), with colours red green blue
// (uchar), and with several surfaces surface_index (uchar). Faces have a list of three int
// vertex_indices.

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

// Returns the header for these counts; its length does not depend on them. Each of `comments` is a
// line.
std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count,
                          bool has_colors = false, bool has_surface_indices = false,
                          const std::vector<std::string>& comments = {});

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_
