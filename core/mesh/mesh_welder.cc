#include "core/mesh/mesh_welder.h"

#include <cstddef>

#include "core/base/check.h"

namespace isoscope::mesh {

bool MeshWelder::IsShared(std::int64_t edge_key) const {
  const math::Index3& dims = layout_.sample_dims();
  const auto axis = static_cast<int>(edge_key % 3);
  const std::int64_t linear = edge_key / 3;
  const math::Index3 sample{linear % dims.x, linear / dims.x % dims.y, linear / (dims.x * dims.y)};
  for (int other = 0; other < 3; ++other) {
    // Along its own axis an edge is inside one block.
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
  numbers_.resize(block.positions.size());
  for (std::size_t i = 0; i < block.positions.size(); ++i) {
    const std::int64_t key = block.edge_keys[i];
    if (IsShared(key)) {
      const auto [entry, is_new] = shared_vertices_.try_emplace(key, vertex_count_);
      if (!is_new) {
        numbers_[i] = entry->second;
        continue;
      }
    }
    numbers_[i] = vertex_count_++;
    part->positions.push_back(block.positions[i]);
    part->normals.push_back(block.normals[i]);
  }
  part->triangles.reserve(block.indices.size());
  for (const std::uint32_t index : block.indices) {
    part->triangles.push_back(numbers_[index]);
  }
}

}  // namespace isoscope::mesh
