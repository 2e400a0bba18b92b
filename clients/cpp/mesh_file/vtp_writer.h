// VTK PolyData (.vtp): XML with raw appended data, for ParaView and VTK.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_VTP_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_VTP_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"

namespace isoscope::client {

// MeshWriter::Create for VTP. Point data: "Normals"; with colours "Colors" (uint8); with several
// surfaces "SurfaceIndex" (uint8).
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateVtp(const MeshFileOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_VTP_WRITER_H_
