#include "client-cli/mesh_piece.h"

#include <cstddef>
#include <cstring>

#include "absl/strings/str_cat.h"

#include "client-cli/output.h"
#include "core/base/coding.h"

namespace isoscope::cli {
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

absl::StatusOr<MeshPiece> DecodeMeshPiece(absl::string_view positions, absl::string_view normals,
                                          absl::string_view triangles, std::int64_t vertex_count) {
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
                                              FormatCount(kMaxVertexCount),
                                              " vertices, the most that a mesh file can hold"));
  }
  MeshPiece piece{.positions = Floats(positions), .normals = Floats(normals), .triangles = {}};
  piece.triangles.resize(triangles.size() / sizeof(std::int64_t));
  for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
    const auto vertex =
        base::LoadLittleEndian<std::int64_t>(triangles.data() + i * sizeof(std::int64_t));
    if (vertex < 0 || vertex >= vertex_count + new_count) {
      return absl::DataLossError(absl::StrCat("malformed chunk of a mesh: triangle ", i / 3,
                                              " of it has vertex ", vertex, "; there are ",
                                              vertex_count + new_count, " so far"));
    }
    piece.triangles[i] = static_cast<std::uint32_t>(vertex);
  }
  return piece;
}

}  // namespace isoscope::cli
