#include "client-cli/output/mesh_files.h"

#include "core/base/status_macros.h"

namespace isoscope::cli {

absl::Status MeshFiles::FinishCurrent() {
  ISOSCOPE_RETURN_IF_ERROR(writer_->Finish());
  reports_.push_back({.path = files_[reports_.size()].path,
                      .vertex_count = writer_->vertex_count(),
                      .triangle_count = writer_->triangle_count(),
                      .size_bytes = writer_->size_bytes()});
  writer_.reset();
  return absl::OkStatus();
}

absl::Status MeshFiles::OpenUpTo(std::size_t file_index) {
  while (reports_.size() < file_index || writer_ == nullptr) {
    if (writer_ == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(writer_, client::MeshWriter::Create(files_[reports_.size()]));
    }
    if (reports_.size() < file_index) {
      ISOSCOPE_RETURN_IF_ERROR(FinishCurrent());
    }
  }
  return absl::OkStatus();
}

absl::Status MeshFiles::Add(const client::MeshPiece& piece) {
  ISOSCOPE_RETURN_IF_ERROR(
      OpenUpTo(has_file_for_each() ? static_cast<std::size_t>(piece.surface_index) : 0));
  origin_ = piece.origin;
  if (piece.triangle_count() > 0) {
    with_triangles_.insert(piece.surface_index);
  }
  if (!has_file_for_each()) {
    return writer_->Add(piece);
  }
  client::MeshPiece own = piece;
  own.surface_index = 0;
  return writer_->Add(own);
}

std::int64_t MeshFiles::VertexCountBefore(int surface_index) const {
  const std::size_t file = has_file_for_each() ? static_cast<std::size_t>(surface_index) : 0;
  return file == reports_.size() && writer_ != nullptr ? writer_->vertex_count() : 0;
}

absl::Status MeshFiles::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(OpenUpTo(files_.size() - 1));
  return FinishCurrent();
}

}  // namespace isoscope::cli
