#include "web-gateway/api/mesh_answer.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/math/vec.h"

namespace isoscope::gateway {

absl::StatusOr<std::unique_ptr<MeshAnswer>> MeshAnswer::Begin(
    const std::vector<client::MeshSurface>& surfaces, const std::optional<client::MeshField>& field,
    const std::string& caller, std::int64_t max_disk_bytes, MeshBudget* budget) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<MeshBudget::Lease> lease, budget->Begin(caller));
  std::unique_ptr<MeshAnswer> mesh(
      new MeshAnswer(max_disk_bytes, surfaces.size(), std::move(lease)));
  std::error_code error;
  std::string folder = (std::filesystem::temp_directory_path(error) / "isoscope-XXXXXX").string();
  // A private folder: no other user can put a file of this name there.
  if (error || mkdtemp(folder.data()) == nullptr) {
    return absl::FailedPreconditionError(
        absl::StrCat("no folder for temporary files can be made (TMPDIR): ",
                     error ? error.message() : std::system_category().message(errno)));
  }
  mesh->path_ = folder + "/mesh.glb";
  const client::MeshFileOptions file{.path = mesh->path_,
                                     .format = client::MeshFormat::kGlb,
                                     .surfaces = surfaces,
                                     .field = field};
  ISOSCOPE_RETURN_IF_ERROR(client::Validate(file));
  ISOSCOPE_ASSIGN_OR_RETURN(mesh->writer_, client::MeshWriter::Create(file));
  return mesh;
}

MeshAnswer::~MeshAnswer() {
  writer_.reset();  // without Finish, this removes the file
  if (!path_.empty()) {
    RemoveTemporaryFile(path_);
  }
}

absl::Status MeshAnswer::Add(const isoscope::v1::ExportIsosurfaceResponse& chunk) {
  std::optional<math::Vec3d> origin;
  if (chunk.has_origin()) {
    origin = {chunk.origin().x(), chunk.origin().y(), chunk.origin().z()};
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const client::MeshPiece piece,
                            decoder_.Decode(chunk.surface_index(), chunk.positions(),
                                            chunk.normals(), chunk.triangles(), origin));
  ISOSCOPE_RETURN_IF_ERROR(CountBytes());
  return writer_->Add(piece);
}

absl::Status MeshAnswer::CountBytes() const {
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 30;
  constexpr std::int64_t kVectorBytes = 3 * sizeof(float);  // also the size of three indices
  const std::int64_t vertices = kVectorBytes * decoder_.vertex_count();
  const std::int64_t triangles = kVectorBytes * decoder_.triangle_count();
  const std::int64_t bytes = 2 * vertices + triangles;
  // While the file is assembled, normals and then indices are on disk twice.
  const std::int64_t disk_bytes = bytes + std::max(vertices, triangles);
  if (bytes > kMaxBytes || disk_bytes > max_disk_bytes_) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh has ", bytes, " bytes or more, and the gateway's limit is ",
                     kMaxBytes, ", or two thirds of --max-mesh-bytes ", max_disk_bytes_,
                     ": clip it, or use 'isoscope export'"));
  }
  return lease_->SetBytes(disk_bytes);
}

absl::StatusOr<HttpResponse> MeshAnswer::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(writer_->Finish());
  ISOSCOPE_RETURN_IF_ERROR(lease_->SetBytes(writer_->size_bytes()));
  HttpResponse response = Header();
  response.file_path = std::exchange(path_, "");
  response.hold = std::move(lease_);
  return response;
}

HttpResponse MeshAnswer::Header() {
  HttpResponse response;
  response.content_type = "model/gltf-binary";
  response.headers = {{"Cache-Control", "no-store"},
                      {"Content-Disposition", "attachment; filename=\"mesh.glb\""}};
  return response;
}

}  // namespace isoscope::gateway
