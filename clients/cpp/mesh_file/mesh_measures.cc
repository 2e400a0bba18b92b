#include "clients/cpp/mesh_file/mesh_measures.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <span>

#include "core/base/status_macros.h"
#include "core/io/file_array.h"
#include "core/math/box.h"
#include "core/math/exact_sum.h"
#include "core/math/vec.h"

namespace isoscope::client {
namespace {

// The lower vertex, the higher one, and the direction, in 31 + 31 + 1 bits.
std::uint64_t SideOf(std::uint32_t from, std::uint32_t to) {
  const auto [low, high] = std::minmax(from, to);
  return std::uint64_t{low} << 32 | std::uint64_t{high} << 1 | (from < to ? 1 : 0);
}

absl::StatusOr<std::int64_t> CountOpenEdges(MeshStore* mesh) {
  const std::span<const std::uint32_t> triangles = mesh->triangles().values();
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint64_t> sides,
                            io::FileArray<std::uint64_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(sides.Resize(triangles.size()));
  std::uint64_t* const data = sides.data();
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    data[i] = SideOf(triangles[i], triangles[i % 3 == 2 ? i - 2 : i + 1]);
  }
  std::sort(data, data + triangles.size());
  std::int64_t count = 0;
  for (std::size_t i = 0; i < triangles.size();) {
    std::int64_t balance = 0;
    const std::uint64_t edge = data[i] >> 1;
    for (; i < triangles.size() && data[i] >> 1 == edge; ++i) {
      balance += (data[i] & 1) != 0 ? 1 : -1;
    }
    count += std::abs(balance);
  }
  return count;
}

}  // namespace

absl::StatusOr<SurfaceMeasures> MeasureMesh(MeshStore* mesh) {
  const std::span<const float> positions = mesh->positions().values();
  const std::span<const std::uint32_t> triangles = mesh->triangles().values();
  const math::Vec3d origin = mesh->origin().value_or(math::Vec3d{});
  const auto position = [&](std::uint32_t vertex) {
    const float* const at = positions.data() + 3 * std::size_t{vertex};
    return origin + math::Vec3d{static_cast<double>(at[0]), static_cast<double>(at[1]),
                                static_cast<double>(at[2])};
  };
  // Volumes are measured from a point near the mesh, so that little is rounded.
  math::Box3d box;
  for (const std::uint32_t vertex : triangles) {
    box.Add(position(vertex));
  }
  math::ExactSum area;
  math::ExactSum volume;
  for (std::size_t i = 0; i + 2 < triangles.size(); i += 3) {
    const math::Vec3d a = position(triangles[i]) - box.min;
    const math::Vec3d b = position(triangles[i + 1]) - box.min;
    const math::Vec3d c = position(triangles[i + 2]) - box.min;
    area.Add(math::Length(math::Cross(b - a, c - a)) / 2);
    volume.Add(math::Dot(a, math::Cross(b, c)) / 6);
  }
  SurfaceMeasures measures{.area = area.Value(), .triangle_count = mesh->triangle_count()};
  ISOSCOPE_ASSIGN_OR_RETURN(measures.open_edge_count, CountOpenEdges(mesh));
  if (measures.open_edge_count == 0) {
    measures.volume = volume.Value();
  }
  return measures;
}

}  // namespace isoscope::client
