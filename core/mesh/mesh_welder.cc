// A vertex is shared by blocks iff its edge lies on a face between them, which its key tells: key =
// 3 * (linear index of the edge's lower sample) + axis, and blocks meet at multiples of
// block_cells. Only those vertices are looked up in a table; all others are new. Vertices of cuts
// are looked up, too. There are few, and their keys do not tell their positions.
//
// Example: blocks of 8 cells in a volume of 17 samples an axis. The x edge at sample (3, 8, 5) lies
// on the face y = 8: its vertex is in two blocks. The y edge there is not shared: it goes from y =
// 8 to 9.

#include "core/mesh/mesh_welder.h"

#include <cstddef>

#include "core/base/check.h"

namespace isoscope::mesh {

bool MeshWelder::IsShared(std::int64_t edge_key) const {
  if (edge_key < 0) {
    return true;
  }
  const math::Index3& dims = layout_.sample_dims();
  const auto axis = static_cast<int>(edge_key % 3);
  const std::int64_t linear = edge_key / 3;
  const math::Index3 sample{linear % dims.x, linear / dims.x % dims.y, linear / (dims.x * dims.y)};
  for (int other = 0; other < 3; ++other) {
    // Blocks meet at samples, so along its own axis an edge lies inside one block.
    if (other != axis && sample[other] % layout_.block_cells()[other] == 0 && sample[other] > 0 &&
        sample[other] < dims[other] - 1) {
      return true;
    }
  }
  return false;
}

void MeshWelder::Add(const BlockMesh& block, WeldedPart* part) {
  ISOSCOPE_CHECK_EQ(block.edge_keys.size(), block.positions.size());
  part->first_vertex = vertex_count_;
  part->positions.clear();
  part->normals.clear();
  part->triangles.clear();
  vertex_ids_.resize(block.positions.size());
  for (std::size_t i = 0; i < block.positions.size(); ++i) {
    const std::int64_t key = block.edge_keys[i];
    if (IsShared(key)) {
      const auto [entry, is_new] = shared_vertices_.try_emplace(key, vertex_count_);
      if (!is_new) {
        vertex_ids_[i] = entry->second;
        continue;
      }
    }
    vertex_ids_[i] = vertex_count_++;
    part->positions.push_back(block.positions[i]);
    part->normals.push_back(block.normals[i]);
  }
  part->triangles.reserve(block.indices.size());
  for (const std::uint32_t index : block.indices) {
    part->triangles.push_back(vertex_ids_[index]);
  }
}

}  // namespace isoscope::mesh
