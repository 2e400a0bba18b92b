#include "client-cli/ply_writer.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/str_cat.h"

#include "client-cli/output.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::cli {
namespace {

constexpr std::size_t kVectorBytes = 3 * sizeof(float);
constexpr std::size_t kTriangleBytes = 3 * sizeof(std::int64_t);
constexpr std::int64_t kCopyBytes = 4 * base::kMiB;
// Room for the two largest counts: 2^31 - 1 vertices, 2^63 - 1 faces.
constexpr std::size_t kCountDigits = 10 + 19;

}  // namespace

std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count) {
  const std::string vertices = absl::StrCat(vertex_count);
  const std::string faces = absl::StrCat(triangle_count);
  // The comment takes up what the counts leave of their room.
  const std::string padding(kCountDigits - vertices.size() - faces.size(), '.');
  return absl::StrCat("ply\nformat binary_little_endian 1.0\ncomment isoscope ", padding,
                      "\nelement vertex ", vertices,
                      "\nproperty float x\nproperty float y\nproperty float z\n"
                      "property float nx\nproperty float ny\nproperty float nz\n"
                      "element face ",
                      faces, "\nproperty list uchar int vertex_indices\nend_header\n");
}

PlyWriter::PlyWriter(const std::string& path)
    : path_(path),
      vertices_path_(PartialName(path)),
      faces_path_(absl::StrCat(PartialName(path), ".faces")) {}

absl::StatusOr<std::unique_ptr<PlyWriter>> PlyWriter::Create(const std::string& path) {
  std::unique_ptr<PlyWriter> writer(new PlyWriter(path));
  for (const std::string& partial : {writer->vertices_path_, writer->faces_path_}) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(writer->vertices_file_, io::CreateWritableFile(writer->vertices_path_));
  ISOSCOPE_ASSIGN_OR_RETURN(writer->faces_file_, io::CreateWritableFile(writer->faces_path_));
  ISOSCOPE_RETURN_IF_ERROR(writer->vertices_file_->Append(MakePlyHeader(0, 0)));
  return writer;
}

PlyWriter::~PlyWriter() {
  // After Finish there is nothing left under these names; before it, an error is on its way.
  io::RemoveRecursively(vertices_path_).IgnoreError();
  io::RemoveRecursively(faces_path_).IgnoreError();
}

absl::Status PlyWriter::AddChunk(absl::string_view positions, absl::string_view normals,
                                 absl::string_view triangles) {
  if (positions.size() % kVectorBytes != 0 || normals.size() != positions.size() ||
      triangles.size() % kTriangleBytes != 0) {
    return absl::DataLossError(absl::StrCat(
        "malformed chunk of a mesh: ", positions.size(), " bytes of positions, ", normals.size(),
        " of normals, ", triangles.size(), " of triangles; expected multiples of ", kVectorBytes,
        ", the same, and of ", kTriangleBytes));
  }
  const std::size_t new_vertex_count = positions.size() / kVectorBytes;
  if (static_cast<std::int64_t>(new_vertex_count) > kMaxVertexCount - vertex_count_) {
    return absl::OutOfRangeError(absl::StrCat("the isosurface has more than ",
                                              FormatCount(kMaxVertexCount),
                                              " vertices, the most that a PLY file can hold"));
  }
  std::string vertices(2 * positions.size(), '\0');
  for (std::size_t i = 0; i < new_vertex_count; ++i) {
    positions.copy(&vertices[2 * i * kVectorBytes], kVectorBytes, i * kVectorBytes);
    normals.copy(&vertices[(2 * i + 1) * kVectorBytes], kVectorBytes, i * kVectorBytes);
  }
  vertex_count_ += static_cast<std::int64_t>(new_vertex_count);

  const std::size_t new_triangle_count = triangles.size() / kTriangleBytes;
  std::string faces;
  faces.reserve(new_triangle_count * (1 + 3 * sizeof(std::int32_t)));
  for (std::size_t i = 0; i < 3 * new_triangle_count; ++i) {
    const auto vertex =
        base::LoadLittleEndian<std::int64_t>(triangles.data() + i * sizeof(std::int64_t));
    if (vertex < 0 || vertex >= vertex_count_) {
      return absl::DataLossError(absl::StrCat("malformed chunk of a mesh: triangle ",
                                              triangle_count_ + static_cast<std::int64_t>(i / 3),
                                              " has vertex ", vertex, "; there are ", vertex_count_,
                                              " so far"));
    }
    if (i % 3 == 0) {
      base::AppendLittleEndian(std::uint8_t{3}, &faces);
    }
    base::AppendLittleEndian(static_cast<std::int32_t>(vertex), &faces);
  }
  triangle_count_ += static_cast<std::int64_t>(new_triangle_count);
  ISOSCOPE_RETURN_IF_ERROR(vertices_file_->Append(vertices));
  return faces_file_->Append(faces);
}

absl::Status PlyWriter::AppendFaces() {
  ISOSCOPE_RETURN_IF_ERROR(faces_file_->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> faces,
                            io::OpenRandomAccessFile(faces_path_));
  std::string buffer;
  for (std::int64_t offset = 0; offset < faces->size_bytes(); offset += kCopyBytes) {
    buffer.resize(static_cast<std::size_t>(std::min(kCopyBytes, faces->size_bytes() - offset)));
    ISOSCOPE_RETURN_IF_ERROR(faces->ReadAt(offset, buffer.size(), buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(vertices_file_->Append(buffer));
  }
  return absl::OkStatus();
}

absl::Status PlyWriter::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(AppendFaces());
  ISOSCOPE_RETURN_IF_ERROR(
      vertices_file_->WriteAt(0, MakePlyHeader(vertex_count_, triangle_count_)));
  ISOSCOPE_RETURN_IF_ERROR(vertices_file_->Close());
  return io::RenamePath(vertices_path_, path_);
}

}  // namespace isoscope::cli
