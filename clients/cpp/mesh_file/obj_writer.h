// Wavefront OBJ: text, "v x y z", or "v x y z r g b" with colours, "vn x y z", "f a//a b//b c//c".

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_OBJ_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_OBJ_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for OBJ. Numbers are the shortest that read back as the same float; positions
// of a mesh with an origin, as the same double.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateObj(const MeshFileOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_OBJ_WRITER_H_
