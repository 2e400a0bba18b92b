// Binary glTF 2.0 (GLB): one mesh with positions, normals and 32-bit indices.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for GLB. Colours become materials. The format is limited to 4 GiB; above it
// the error is OUT_OF_RANGE. Coordinates are the world's, although glTF defines y as up and metres
// as units.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateGlb(const MeshFileOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_
