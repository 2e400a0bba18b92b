// Joins the meshes of blocks to one mesh in which every vertex of the volume appears once. Exports
// and tests use it, block by block:
//
//   MeshWelder welder(layout);
//   WeldedPart part;
//   for (const BlockMesh& block : blocks) {  // ascending block ids
//     welder.Add(block, &part);
//     Write(part);
//   }

#ifndef ISOSCOPE_CORE_MESH_MESH_WELDER_H_
#define ISOSCOPE_CORE_MESH_MESH_WELDER_H_

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"

namespace isoscope::mesh {

// The vertices and triangles that one block adds to the welded mesh.
struct WeldedPart {
  std::int64_t first_vertex = 0;        // vertex id of positions[0]
  std::vector<math::Vec3f> positions;   // new vertices, in index space (samples)
  std::vector<math::Vec3f> normals;     // one for each position, as BlockMesh::normals
  std::vector<std::int64_t> triangles;  // three vertex ids for each triangle
};

// Gives every vertex of the volume one vertex id, counting from 0. Vertices of equal position and
// copy number are one. Remembers those on faces between blocks, and no others. Thread-compatible.
class MeshWelder {
 public:
  explicit MeshWelder(const volume::BlockLayout& layout) : layout_(layout) {}

  // Replaces `part` by the vertices and triangles that `block` adds. Vertex ids count in the order
  // of the calls, so ascending block ids give the same mesh every time. REQUIRES: `block` was not
  // added before; it has no two vertices of equal position and copy number.
  void Add(const BlockMesh& block, WeldedPart* part);

  // Vertices of the welded mesh so far.
  [[nodiscard]] std::int64_t vertex_count() const { return vertex_count_; }

 private:
  // The bits of a position, and a copy number.
  using Key = std::pair<std::array<std::uint32_t, 3>, std::uint8_t>;

  // Returns true if the position lies on a face between blocks.
  [[nodiscard]] bool IsShared(const math::Vec3f& position) const;

  const volume::BlockLayout layout_;
  std::int64_t vertex_count_ = 0;
  absl::flat_hash_map<Key, std::int64_t> shared_vertices_;  // vertex ids
  std::vector<std::int64_t> vertex_ids_;  // of the current block, by its own vertex indices
};

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_MESH_WELDER_H_
