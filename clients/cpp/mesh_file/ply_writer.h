// Binary little-endian PLY: vertices with x y z nx ny nz (float) and, if wanted, red green blue
// (uchar), and of several surfaces surface_index (uchar); faces with a list of three int
// vertex_indices.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for PLY.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreatePly(const MeshFileOptions& options);

// The header for these counts: its length does not depend on them.
std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count,
                          bool has_colors = false, bool has_surface_indices = false);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_PLY_WRITER_H_
