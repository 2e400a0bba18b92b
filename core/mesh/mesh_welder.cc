// A vertex may be shared by blocks iff it lies on a face between them, which its position tells:
// blocks meet at multiples of block_cells. Only those vertices are looked up in a table; all others
// are new.
//
// Example: blocks of 8 cells in a volume of 17 samples an axis. A vertex at (3.5, 8, 5) lies on the
// face y = 8: it is in two blocks. One at (3, 8.5, 5) is in one.

#include "core/mesh/mesh_welder.h"

#include <bit>
#include <cmath>
#include <cstddef>

#include "core/base/check.h"

namespace isoscope::mesh {

bool MeshWelder::IsShared(const math::Vec3f& position) const {
  for (int axis = 0; axis < 3; ++axis) {
    const auto sample = static_cast<std::int64_t>(position[axis]);
    if (static_cast<float>(sample) == position[axis] && sample % layout_.block_cells()[axis] == 0 &&
        sample > 0 && sample < layout_.sample_dims()[axis] - 1) {
      return true;
    }
  }
  return false;
}

void MeshWelder::Add(const BlockMesh& block, WeldedPart* part) {
  ISOSCOPE_CHECK(block.copies.empty() || block.copies.size() == block.positions.size());
  part->first_vertex = vertex_count_;
  part->positions.clear();
  part->normals.clear();
  part->triangles.clear();
  vertex_ids_.resize(block.positions.size());
  for (std::size_t i = 0; i < block.positions.size(); ++i) {
    const math::Vec3f& position = block.positions[i];
    if (IsShared(position)) {
      // Adding 0 makes 0 of -0.
      const Key key{{std::bit_cast<std::uint32_t>(position.x + 0.0F),
                     std::bit_cast<std::uint32_t>(position.y + 0.0F),
                     std::bit_cast<std::uint32_t>(position.z + 0.0F)},
                    block.copies.empty() ? std::uint8_t{0} : block.copies[i]};
      const auto [entry, is_new] = shared_vertices_.try_emplace(key, vertex_count_);
      if (!is_new) {
        vertex_ids_[i] = entry->second;
        continue;
      }
    }
    vertex_ids_[i] = vertex_count_++;
    part->positions.push_back(position);
    part->normals.push_back(block.normals[i]);
  }
  part->triangles.reserve(block.indices.size());
  for (const std::uint32_t index : block.indices) {
    part->triangles.push_back(vertex_ids_[index]);
  }
}

}  // namespace isoscope::mesh
