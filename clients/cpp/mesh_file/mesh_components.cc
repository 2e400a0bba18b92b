// Union-find over vertices, with path halving; the smaller index is the root. Based on: Tarjan, van
// Leeuwen: Worst-case analysis of set union algorithms, Journal of the ACM 31 (1984).

#include "clients/cpp/mesh_file/mesh_components.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>

#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

std::uint32_t RootOf(std::uint32_t vertex, std::uint32_t* parents) {
  while (parents[vertex] != vertex) {
    parents[vertex] = parents[parents[vertex]];
    vertex = parents[vertex];
  }
  return vertex;
}

void Join(std::uint32_t a, std::uint32_t b, std::uint32_t* parents) {
  const std::uint32_t root_a = RootOf(a, parents);
  const std::uint32_t root_b = RootOf(b, parents);
  parents[std::max(root_a, root_b)] = std::min(root_a, root_b);
}

}  // namespace

absl::StatusOr<DroppedComponents> DropSmallComponents(std::int64_t min_triangles, MeshStore* mesh) {
  const auto vertex_count = static_cast<std::size_t>(mesh->vertex_count());
  const std::span<std::uint32_t> triangles = mesh->triangles().values();
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> parents,
                            io::FileArray<std::uint32_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(parents.Resize(vertex_count));
  for (std::size_t i = 0; i < vertex_count; ++i) {
    parents.data()[i] = static_cast<std::uint32_t>(i);
  }
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    Join(triangles[i], triangles[i + 1], parents.data());
    Join(triangles[i], triangles[i + 2], parents.data());
  }
  // Triangles of each root; the count saturates at 2^32 - 1.
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> counts,
                            io::FileArray<std::uint32_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(counts.Resize(vertex_count));
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    std::uint32_t& count = counts.data()[RootOf(triangles[i], parents.data())];
    if (count < std::numeric_limits<std::uint32_t>::max()) {
      ++count;
    }
  }
  DroppedComponents dropped;
  for (const std::uint32_t count : counts.values()) {
    dropped.component_count += count > 0 ? 1 : 0;
    dropped.dropped_count += count > 0 && count < min_triangles ? 1 : 0;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    if (counts.data()[RootOf(triangles[i], parents.data())] < min_triangles) {
      ++dropped.dropped_triangle_count;
      continue;
    }
    std::copy_n(triangles.begin() + static_cast<std::ptrdiff_t>(i), 3,
                triangles.begin() + static_cast<std::ptrdiff_t>(kept));
    kept += 3;
  }
  ISOSCOPE_RETURN_IF_ERROR(mesh->triangles().Resize(kept));
  return dropped;
}

}  // namespace isoscope::client
