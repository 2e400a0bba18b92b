// VTK PolyData (.vtp): XML with raw appended data, for ParaView and VTK.

#ifndef ISOSCOPE_CLIENT_CLI_VTP_WRITER_H_
#define ISOSCOPE_CLIENT_CLI_VTP_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "client-cli/mesh_writer.h"

namespace isoscope::cli {

// MeshWriter::Create for VTP. Point data: "Normals", "Colors" (uint8) if wanted, and of
// several surfaces "SurfaceIndex" (uint8).
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateVtp(const MeshFileOptions& options);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_VTP_WRITER_H_
