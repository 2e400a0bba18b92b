#include "clients/cpp/mesh_file/mesh_store.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

// Vertices or triangles of an emitted piece.
constexpr std::size_t kPieceSize = std::size_t{1} << 16;

void AppendVector(std::span<const float> vectors, std::size_t i, std::vector<float>* out) {
  out->insert(out->end(), vectors.begin() + static_cast<std::ptrdiff_t>(3 * i),
              vectors.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
}

}  // namespace

absl::StatusOr<std::unique_ptr<MeshStore>> MeshStore::Create(const std::string& directory) {
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<float> positions,
                            io::FileArray<float>::Create(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<float> normals, io::FileArray<float>::Create(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> triangles,
                            io::FileArray<std::uint32_t>::Create(directory));
  return std::unique_ptr<MeshStore>(
      new MeshStore(directory, std::move(positions), std::move(normals), std::move(triangles)));
}

absl::Status MeshStore::Add(const MeshPiece& piece) {
  origin_ = piece.origin;
  ISOSCOPE_RETURN_IF_ERROR(positions_.Append(piece.positions));
  ISOSCOPE_RETURN_IF_ERROR(normals_.Append(piece.normals));
  return triangles_.Append(piece.triangles);
}

absl::StatusOr<std::uint32_t> MeshStore::AddMean(std::initializer_list<std::uint32_t> vertices) {
  const auto vertex = static_cast<std::uint32_t>(vertex_count());
  std::array<double, 3> position{};
  std::array<double, 3> normal{};
  for (const std::uint32_t one : vertices) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      position[axis] += static_cast<double>(positions_.data()[3 * std::size_t{one} + axis]);
      normal[axis] += static_cast<double>(normals_.data()[3 * std::size_t{one} + axis]);
    }
  }
  const auto count = static_cast<double>(vertices.size());
  const double length =
      std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
  const double scale = vertices.size() == 1 || length == 0 ? 1 : 1 / length;
  std::vector<float> mean_position;
  std::vector<float> mean_normal;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    mean_position.push_back(static_cast<float>(position[axis] / count));
    mean_normal.push_back(static_cast<float>(normal[axis] * scale));
  }
  ISOSCOPE_RETURN_IF_ERROR(positions_.Append(mean_position));
  ISOSCOPE_RETURN_IF_ERROR(normals_.Append(mean_normal));
  return vertex;
}

absl::Status MeshStore::Emit(MeshSink* sink, std::int64_t first_vertex, int surface_index) const {
  const std::span<const float> positions = positions_.values();
  const std::span<const float> normals = normals_.values();
  const std::span<const std::uint32_t> triangles = triangles_.values();
  const std::size_t vertex_count = positions.size() / 3;
  // First 1 for each vertex in use, then 1 + its new index.
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> new_index,
                            io::FileArray<std::uint32_t>::Create(directory_));
  ISOSCOPE_RETURN_IF_ERROR(new_index.Resize(vertex_count));
  for (const std::uint32_t vertex : triangles) {
    new_index.data()[vertex] = 1;
  }
  std::uint32_t used_count = 0;
  const MeshPiece empty{.surface_index = surface_index, .origin = origin_};
  MeshPiece piece = empty;
  for (std::size_t i = 0; i < vertex_count; ++i) {
    if (new_index.data()[i] != 0) {
      new_index.data()[i] = ++used_count;
      AppendVector(positions, i, &piece.positions);
      AppendVector(normals, i, &piece.normals);
    }
    if (piece.positions.size() >= 3 * kPieceSize) {
      ISOSCOPE_RETURN_IF_ERROR(sink->Add(piece));
      piece = empty;
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(sink->Add(piece));
  for (std::size_t begin = 0; begin < triangles.size(); begin += 3 * kPieceSize) {
    const std::size_t end = std::min(triangles.size(), begin + 3 * kPieceSize);
    piece = empty;
    for (std::size_t i = begin; i < end; ++i) {
      piece.triangles.push_back(static_cast<std::uint32_t>(first_vertex) +
                                new_index.data()[triangles[i]] - 1);
    }
    ISOSCOPE_RETURN_IF_ERROR(sink->Add(piece));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::client
