// Joins block meshes to one mesh in which every vertex of the volume appears once, block by block:
// for export, and for tests that look at a whole surface.
//
//   MeshWelder welder(layout);
//   WeldedPart part;
//   for (const BlockMesh& block : blocks) {  // ascending block ids
//     welder.Add(block, &part);
//     Write(part);
//   }

#ifndef ISOSCOPE_CORE_MESH_MESH_WELDER_H_
#define ISOSCOPE_CORE_MESH_MESH_WELDER_H_

#include <cstdint>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"

namespace isoscope::mesh {

// What one block adds to the welded mesh.
struct WeldedPart {
  std::int64_t first_vertex = 0;        // the number of positions[0] in the welded mesh
  std::vector<math::Vec3f> positions;   // new vertices, in index space (samples)
  std::vector<math::Vec3f> normals;     // one for each position, as BlockMesh::normals
  std::vector<std::int64_t> triangles;  // three vertex numbers of the welded mesh for each
};

// Thread-compatible. Remembers the vertices on faces between blocks: O(those) memory, whatever the
// size of the mesh.
class MeshWelder {
 public:
  explicit MeshWelder(const volume::BlockLayout& layout) : layout_(layout) {}

  // Replaces `part` by what `block` adds. Vertices are numbered in the order in which they come, so
  // ascending block ids give the same mesh every time. REQUIRES: no block was added before; edge
  // keys were asked for at extraction.
  void Add(const BlockMesh& block, WeldedPart* part);

  // So far.
  [[nodiscard]] std::int64_t vertex_count() const { return vertex_count_; }

 private:
  [[nodiscard]] bool IsShared(std::int64_t edge_key) const;

  const volume::BlockLayout layout_;
  std::int64_t vertex_count_ = 0;
  absl::flat_hash_map<std::int64_t, std::int64_t> shared_vertices_;  // edge key -> vertex number
  std::vector<std::int64_t> numbers_;  // of the block at hand, by its own vertex indices
};

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_MESH_WELDER_H_
