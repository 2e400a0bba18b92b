// Wavefront OBJ: text, "v x y z", or "v x y z r g b" with colours, "vn x y z", "f a//a b//b c//c".

#ifndef ISOSCOPE_CLIENT_CLI_OBJ_WRITER_H_
#define ISOSCOPE_CLIENT_CLI_OBJ_WRITER_H_

#include <memory>

#include "absl/status/statusor.h"

#include "client-cli/mesh_writer.h"

namespace isoscope::cli {

// MeshWriter::Create for OBJ. Numbers are the shortest that read back as the same float.
absl::StatusOr<std::unique_ptr<MeshWriter>> CreateObj(const MeshFileOptions& options);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OBJ_WRITER_H_
