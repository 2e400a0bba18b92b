#include "clients/cpp/mesh_file/mesh_piece.h"

#include <cstddef>
#include <cstring>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kVectorBytes = 3 * sizeof(float);
constexpr std::size_t kTriangleBytes = 3 * sizeof(std::int64_t);

std::vector<float> Floats(absl::string_view bytes) {
  std::vector<float> values(bytes.size() / sizeof(float));
  // A chunk may bring triangles alone; memcpy takes no null pointer even for 0 bytes.
  if (!values.empty()) {
    std::memcpy(values.data(), bytes.data(), values.size() * sizeof(float));
  }
  return values;
}

}  // namespace

std::string TextOfOrigin(const math::Vec3d& origin) {
  return absl::StrCat(cli::FormatValue(origin.x), " ", cli::FormatValue(origin.y), " ",
                      cli::FormatValue(origin.z));
}

absl::StatusOr<MeshPiece> DecodeMeshPiece(absl::string_view positions, absl::string_view normals,
                                          absl::string_view triangles, std::int64_t vertex_count,
                                          std::int64_t first_vertex) {
  if (positions.size() % kVectorBytes != 0 || normals.size() != positions.size() ||
      triangles.size() % kTriangleBytes != 0) {
    return absl::DataLossError(absl::StrCat(
        "malformed chunk of a mesh: ", positions.size(), " bytes of positions, ", normals.size(),
        " of normals, ", triangles.size(), " of triangles; expected multiples of ", kVectorBytes,
        ", the same, and of ", kTriangleBytes));
  }
  const auto new_count = static_cast<std::int64_t>(positions.size() / kVectorBytes);
  if (new_count > kMaxVertexCount - vertex_count) {
    return absl::OutOfRangeError(absl::StrCat("the isosurface has more than ",
                                              cli::FormatCount(kMaxVertexCount),
                                              " vertices, the most that a mesh file can hold"));
  }
  MeshPiece piece;
  piece.positions = Floats(positions);
  piece.normals = Floats(normals);
  piece.triangles.resize(triangles.size() / sizeof(std::int64_t));
  for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
    const auto vertex =
        base::LoadLittleEndian<std::int64_t>(triangles.data() + i * sizeof(std::int64_t));
    if (vertex < first_vertex || vertex >= vertex_count + new_count) {
      return absl::DataLossError(
          absl::StrCat("malformed chunk of a mesh: triangle ", i / 3, " of it has vertex ", vertex,
                       "; there are ", vertex_count + new_count,
                       " so far, of this surface those from ", first_vertex, " on"));
    }
    piece.triangles[i] = static_cast<std::uint32_t>(vertex);
  }
  return piece;
}

absl::StatusOr<MeshPiece> MeshDecoder::Decode(int surface_index, absl::string_view positions,
                                              absl::string_view normals,
                                              absl::string_view triangles,
                                              const std::optional<math::Vec3d>& origin) {
  if (origin.has_value() && !math::IsFinite(*origin)) {
    return absl::DataLossError("malformed chunk of a mesh: its origin is not finite");
  }
  if (has_begun_ && origin != origin_) {
    return absl::DataLossError(
        "malformed chunk of a mesh: its origin is not that of the first one");
  }
  origin_ = origin;
  has_begun_ = true;
  if (surface_index < surface_index_ || surface_index >= surface_count_) {
    return absl::DataLossError(absl::StrCat("malformed chunk of a mesh: it is of surface ",
                                            surface_index, ", after surface ", surface_index_,
                                            " of ", surface_count_));
  }
  if (surface_index > surface_index_) {
    surface_index_ = surface_index;
    first_vertex_ = vertex_count_;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(MeshPiece piece, DecodeMeshPiece(positions, normals, triangles,
                                                             vertex_count_, first_vertex_));
  piece.surface_index = surface_index;
  piece.origin = origin;
  vertex_count_ += piece.vertex_count();
  triangle_count_ += piece.triangle_count();
  return piece;
}

}  // namespace isoscope::client
