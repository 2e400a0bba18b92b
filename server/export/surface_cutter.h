// Cuts the meshes of blocks at the borders of a clip region, so that exports match frames.

#ifndef ISOSCOPE_SERVER_EXPORT_SURFACE_CUTTER_H_
#define ISOSCOPE_SERVER_EXPORT_SURFACE_CUTTER_H_

#include <cstdint>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/mesh/block_mesh.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"

namespace isoscope::server {

// Cuts the blocks of one surface. Keeps the keys of its new vertices. Thread-compatible.
class SurfaceCutter {
 public:
  SurfaceCutter(view::Clipper clipper, const volume::BlockLayout& layout)
      : clipper_(std::move(clipper)), layout_(layout) {}

  // Removes the triangles outside, and the vertices that no triangle needs any more. A vertex or a
  // triangle that lies on a border stays as it is.
  //
  // A new vertex lies where its edge meets the border; its normal is interpolated. It has a
  // negative edge key: one for each edge of the whole mesh, so that the welder joins the cut sides
  // of neighbouring blocks. REQUIRES: `block` has edge keys; blocks come in a fixed order, if the
  // keys are to be the same every time.
  void Cut(mesh::BlockMesh* block);

 private:
  // The keys of the ends of an edge: the one inside first.
  using Edge = std::pair<std::int64_t, std::int64_t>;

  void CutBy(const view::HalfSpace& half_space, mesh::BlockMesh* block);
  // Returns the vertex where an edge of the block meets the border.
  std::uint32_t VertexOn(std::uint32_t inside, std::uint32_t outside, mesh::BlockMesh* block);
  void DropUnused(mesh::BlockMesh* block);

  const view::Clipper clipper_;
  const volume::BlockLayout layout_;
  absl::flat_hash_map<Edge, std::int64_t> keys_;  // of the vertices made so far
  // State of the block in work.
  std::vector<double> distances_;                          // of each vertex to the border
  absl::flat_hash_map<std::int64_t, std::uint32_t> made_;  // key -> vertex
  std::vector<std::uint32_t> indices_;
  std::vector<std::uint32_t> new_index_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_EXPORT_SURFACE_CUTTER_H_
