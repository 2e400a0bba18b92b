#include "web-gateway/api/mesh_answer.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/math/vec.h"
#include "web-gateway/api/answer_file.h"

namespace isoscope::gateway {
namespace {

std::string NameOfFile(client::MeshFormat format) {
  return absl::StrCat("mesh.", client::NameOf(format));
}

}  // namespace

std::string MeshMediaType(client::MeshFormat format) {
  switch (format) {
    case client::MeshFormat::kGlb:
      return "model/gltf-binary";
    case client::MeshFormat::kObj:
      return "model/obj";
    case client::MeshFormat::kStl:
      return "model/stl";
    case client::MeshFormat::kPly:
    case client::MeshFormat::kVtp:
      break;
  }
  return "application/octet-stream";
}

absl::StatusOr<std::unique_ptr<MeshAnswer>> MeshAnswer::Begin(
    client::MeshFormat format, const std::vector<client::MeshSurface>& surfaces,
    const std::optional<client::MeshField>& field, const std::string& caller,
    std::int64_t max_disk_bytes, MeshBudget* budget) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<MeshBudget::Lease> lease, budget->Begin(caller));
  std::unique_ptr<MeshAnswer> mesh(
      new MeshAnswer(format, max_disk_bytes, surfaces.size(), std::move(lease)));
  ISOSCOPE_ASSIGN_OR_RETURN(mesh->path_, MakeAnswerPath(NameOfFile(format)));
  const client::MeshFileOptions file{
      .path = mesh->path_, .format = format, .surfaces = surfaces, .field = field};
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
  ISOSCOPE_RETURN_IF_ERROR(writer_->Add(piece));
  return CountBytes();
}

absl::Status MeshAnswer::CountBytes() const {
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 30;
  const client::DiskUse disk = writer_->disk_use();
  if (disk.file_bytes > kMaxBytes || disk.peak_bytes > max_disk_bytes_) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh has ", disk.file_bytes,
                     " bytes or more, and the gateway's limit is ", kMaxBytes, "; it takes ",
                     disk.peak_bytes, " of disk while it is put together, and --max-mesh-bytes is ",
                     max_disk_bytes_, ": clip it, or use 'isoscope export'"));
  }
  return lease_->SetBytes(disk.peak_bytes);
}

absl::StatusOr<HttpResponse> MeshAnswer::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(writer_->Finish());
  ISOSCOPE_RETURN_IF_ERROR(lease_->SetBytes(writer_->size_bytes()));
  HttpResponse response = Header(format_);
  response.file_path = std::exchange(path_, "");
  response.hold = std::move(lease_);
  return response;
}

HttpResponse MeshAnswer::Header(client::MeshFormat format) {
  HttpResponse response;
  response.content_type = MeshMediaType(format);
  response.headers = {
      {"Cache-Control", "no-store"},
      {"Content-Disposition", absl::StrCat("attachment; filename=\"", NameOfFile(format), "\"")}};
  return response;
}

}  // namespace isoscope::gateway
