// Binary glTF 2.0 (GLB): one mesh with positions, normals and 32-bit indices.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for GLB. The colour is that of the material. The format ends at 4 GiB: beyond,
// OUT_OF_RANGE. Coordinates are the world's, although glTF takes its y axis for up and its units
// for metres.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateGlb(const MeshFileOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_GLB_WRITER_H_
