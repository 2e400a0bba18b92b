#include "tests/support/mesh_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "absl/container/flat_hash_map.h"

#include "core/base/check.h"
#include "core/math/matrix.h"
#include "core/mesh/mesh_welder.h"

namespace isoscope::testing {
namespace {

math::Vec3d ToDouble(const math::Vec3f& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

// Counts edges by their number of triangles. `uses` holds, for each side of each triangle,
// lower vertex << 32 | higher vertex << 1 | direction.
void CountEdges(std::vector<std::uint64_t>* uses, MeshMetrics* metrics) {
  std::sort(uses->begin(), uses->end());
  for (std::size_t begin = 0; begin < uses->size();) {
    std::size_t end = begin + 1;
    while (end < uses->size() && (*uses)[end] >> 1 == (*uses)[begin] >> 1) {
      ++end;
    }
    ++metrics->edge_count;
    if (end - begin == 1) {
      ++metrics->boundary_edge_count;
    } else if (end - begin > 2) {
      ++metrics->non_manifold_edge_count;
    } else if ((*uses)[begin] == (*uses)[begin + 1]) {
      ++metrics->inconsistent_edge_count;
    }
    begin = end;
  }
}

}  // namespace

WeldedMesh Weld(const volume::BlockLayout& layout, std::span<const mesh::BlockMesh> blocks) {
  WeldedMesh mesh;
  mesh::MeshWelder welder(layout);
  mesh::WeldedPart part;
  absl::flat_hash_map<std::int64_t, std::int64_t> vertex_of_key;
  for (const mesh::BlockMesh& block : blocks) {
    if (block.edge_keys.empty()) {
      welder.Add(block, &part);
    } else {
      part = {};
      std::vector<std::int64_t> ids;
      for (std::size_t i = 0; i < block.positions.size(); ++i) {
        const auto next = static_cast<std::int64_t>(vertex_of_key.size());
        const auto [entry, is_new] = vertex_of_key.try_emplace(block.edge_keys[i], next);
        ids.push_back(entry->second);
        if (is_new) {
          part.positions.push_back(block.positions[i]);
          part.normals.push_back(block.normals[i]);
        }
      }
      for (const std::uint32_t index : block.indices) {
        part.triangles.push_back(ids[index]);
      }
    }
    mesh.positions.insert(mesh.positions.end(), part.positions.begin(), part.positions.end());
    mesh.normals.insert(mesh.normals.end(), part.normals.begin(), part.normals.end());
    mesh.triangles.insert(mesh.triangles.end(), part.triangles.begin(), part.triangles.end());
  }
  return mesh;
}

MeshMetrics Measure(const WeldedMesh& mesh, const volume::GridGeometry& geometry) {
  ISOSCOPE_CHECK_LT(mesh.positions.size(), std::size_t{1} << 31);
  const math::Mat4d world_from_index = geometry.world_from_index();
  const math::Mat3d& directions = geometry.direction;
  const double cell_volume = std::fabs(math::Determinant(directions)) * geometry.spacing.x *
                             geometry.spacing.y * geometry.spacing.z;
  MeshMetrics metrics;
  metrics.triangle_count = static_cast<std::int64_t>(mesh.triangles.size() / 3);
  std::vector<bool> is_used(mesh.positions.size());
  std::vector<std::uint64_t> uses;
  uses.reserve(mesh.triangles.size());
  // Volumes are summed about a point of the mesh, to cancel less.
  const math::Vec3d center =
      mesh.positions.empty() ? math::Vec3d{} : ToDouble(mesh.positions.front());
  for (std::size_t i = 0; i + 2 < mesh.triangles.size(); i += 3) {
    std::array<math::Vec3d, 3> corners;
    std::array<math::Vec3d, 3> world;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto from = static_cast<std::uint64_t>(mesh.triangles[i + k]);
      const auto to = static_cast<std::uint64_t>(mesh.triangles[i + (k + 1) % 3]);
      uses.push_back(std::min(from, to) << 32 | std::max(from, to) << 1 | (from < to ? 1 : 0));
      is_used[from] = true;
      corners[k] = ToDouble(mesh.positions[from]);
      world[k] = math::TransformPoint(world_from_index, corners[k]);
    }
    const math::Vec3d normal = math::Cross(corners[1] - corners[0], corners[2] - corners[0]);
    if (normal == math::Vec3d{}) {
      ++metrics.degenerate_triangle_count;
    }
    metrics.area += 0.5 * math::Length(math::Cross(world[1] - world[0], world[2] - world[0]));
    metrics.volume += math::Dot(corners[0] - center, normal) / 6 * cell_volume;
  }
  metrics.vertex_count = std::count(is_used.begin(), is_used.end(), true);
  CountEdges(&uses, &metrics);
  return metrics;
}

}  // namespace isoscope::testing
