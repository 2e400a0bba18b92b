#include "clients/cpp/mesh_file/ply_writer.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kPlyVectorBytes = 3 * sizeof(float);
constexpr std::size_t kFaceBytes = 1 + 3 * sizeof(std::int32_t);
// Room for the two largest counts: 2^31 - 1 vertices, 2^63 - 1 faces.
constexpr std::size_t kCountDigits = 10 + 19;

enum Section : std::size_t { kVertices, kFaces };

// The lines of three properties.
std::string PropertiesOf(absl::string_view type, const std::array<const char*, 3>& names) {
  std::string lines;
  for (const char* name : names) {
    absl::StrAppend(&lines, "property ", type, " ", name, "\n");
  }
  return lines;
}

class PlyWriter : public MeshWriter {
 public:
  explicit PlyWriter(const MeshFileOptions& options) : options_(options) {
    vertex_.has_colors = options.has_colors();
    vertex_.has_surface_index = options.surfaces.size() > 1;
    vertex_.has_wide_index = options.surfaces.size() > kMaxByteIndices;
  }

  absl::Status Open() {
    ISOSCOPE_ASSIGN_OR_RETURN(file_, SectionedFile::Create(options_.path, Header().size(), 2));
    return absl::OkStatus();
  }

  absl::Status AddPiece(const MeshPiece& piece) override {
    if (piece.origin.has_value() && !vertex_.has_doubles) {
      // The first piece: the header becomes longer.
      vertex_.has_doubles = true;
      file_.reset();
      ISOSCOPE_RETURN_IF_ERROR(Open());
    }
    const std::vector<double> world =
        vertex_.has_doubles ? WorldPositionsOf(piece) : std::vector<double>();
    const auto vertex_count = static_cast<std::size_t>(piece.vertex_count());
    std::string vertices;
    const std::string tail = VertexTail(piece.surface_index);
    vertices.reserve(vertex_count * (3 * kPlyVectorBytes + tail.size()));
    for (std::size_t i = 0; i < vertex_count; ++i) {
      if (vertex_.has_doubles) {
        vertices.append(reinterpret_cast<const char*>(&world[3 * i]), 2 * kPlyVectorBytes);
      } else {
        vertices.append(reinterpret_cast<const char*>(&piece.positions[3 * i]), kPlyVectorBytes);
      }
      vertices.append(reinterpret_cast<const char*>(&piece.normals[3 * i]), kPlyVectorBytes);
      vertices += tail;
    }
    std::string faces;
    faces.reserve(static_cast<std::size_t>(piece.triangle_count()) * kFaceBytes);
    for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
      if (i % 3 == 0) {
        base::AppendLittleEndian(std::uint8_t{3}, &faces);
      }
      base::AppendLittleEndian(static_cast<std::int32_t>(piece.triangles[i]), &faces);
    }
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kVertices, vertices));
    return file_->Append(kFaces, faces);
  }

  absl::Status Finish() override { return file_->Finish(Header()); }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] DiskUse disk_use() const override { return file_->disk_use(); }

 private:
  [[nodiscard]] std::string Header() const {
    return MakePlyHeader(
        vertex_count(), triangle_count(), vertex_,
        options_.field.has_value() ? LinesOf(*options_.field) : std::vector<std::string>());
  }

  // Returns the bytes after the normal of each vertex of a surface.
  [[nodiscard]] std::string VertexTail(int surface_index) const {
    std::string tail;
    if (vertex_.has_colors) {
      for (const std::uint8_t channel : ToBytes(options_.ColorOf(surface_index))) {
        base::AppendLittleEndian(channel, &tail);
      }
    }
    if (vertex_.has_wide_index) {
      base::AppendLittleEndian(static_cast<std::int32_t>(surface_index), &tail);
    } else if (vertex_.has_surface_index) {
      base::AppendLittleEndian(static_cast<std::uint8_t>(surface_index), &tail);
    }
    return tail;
  }

  const MeshFileOptions options_;
  PlyVertex vertex_;
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

std::string MakePlyHeader(std::int64_t vertex_count, std::int64_t triangle_count,
                          const PlyVertex& vertex, const std::vector<std::string>& comments) {
  const std::string vertices = absl::StrCat(vertex_count);
  const std::string faces = absl::StrCat(triangle_count);
  // The comment pads the room that the counts leave.
  const std::string padding(kCountDigits - vertices.size() - faces.size(), '.');
  std::string lines;
  for (const std::string& comment : comments) {
    absl::StrAppend(&lines, "comment ", comment, "\n");
  }
  return absl::StrCat("ply\nformat binary_little_endian 1.0\ncomment isoscope ", padding, "\n",
                      lines, "element vertex ", vertices, "\n",
                      PropertiesOf(vertex.has_doubles ? "double" : "float", {"x", "y", "z"}),
                      PropertiesOf("float", {"nx", "ny", "nz"}),
                      vertex.has_colors ? PropertiesOf("uchar", {"red", "green", "blue"}) : "",
                      !vertex.has_surface_index ? ""
                      : vertex.has_wide_index   ? "property int surface_index\n"
                                                : "property uchar surface_index\n",
                      "element face ", faces,
                      "\nproperty list uchar int vertex_indices\nend_header\n");
}

absl::StatusOr<std::unique_ptr<MeshWriter>> CreatePly(const MeshFileOptions& options) {
  auto writer = std::make_unique<PlyWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

}  // namespace isoscope::client
