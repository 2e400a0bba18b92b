// Merges the parts of a surface, whose blocks lie in several places, by block id, welds them, and takes
// them to world space.

#ifndef ISOSCOPE_CORE_MESH_SURFACE_MERGER_H_
#define ISOSCOPE_CORE_MESH_SURFACE_MERGER_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::mesh {

// One part of a surface, block by block.
class SurfaceSource {
 public:
  virtual ~SurfaceSource() = default;
  // Replaces `block` by the next one. Block ids ascend. False at the end.
  virtual absl::StatusOr<bool> Next(BlockMesh* block) = 0;
};

// A part of the welded mesh, with the fields of isoscope.v1.ExportIsosurfaceResponse.
struct SurfaceChunk {
  std::string positions;
  std::string normals;
  std::string triangles;

  [[nodiscard]] std::size_t size_bytes() const {
    return positions.size() + normals.size() + triangles.size();
  }
};
// The most bytes of a chunk.
inline constexpr std::size_t kSurfaceChunkBytes = 1 << 20;

// The grid of a surface.
struct SurfaceGrid {
  volume::GridGeometry geometry;
  volume::BlockLayout layout;
  // Whether positions are from the origin of WorldPlacement.
  bool has_origin = false;
};

// Pulls all sources to their ends, and gives the welded mesh to `emit` in chunks of at most
// kSurfaceChunkBytes. The chunks do not depend on how blocks are spread over sources. Stops at the
// first error of a source or of `emit`. Returns the number of vertices. INTERNAL if block ids do not ascend.
//
// first_vertex: of this surface; vertices of earlier surfaces come before it
//
absl::StatusOr<std::int64_t> MergeSurface(const SurfaceGrid& grid,
                                          const std::vector<SurfaceSource*>& sources,
                                          std::int64_t first_vertex,
                                          absl::FunctionRef<absl::Status(SurfaceChunk)> emit);

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_SURFACE_MERGER_H_
