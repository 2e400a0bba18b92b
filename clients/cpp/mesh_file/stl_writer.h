// Binary STL: 80 bytes of text, a count, and for each triangle its normal and its three corners.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_STL_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_STL_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for STL: at most 2^32 - 1 triangles. Normals are those of the triangles, 0 for
// degenerate ones.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateStl(const MeshFileOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_STL_WRITER_H_
