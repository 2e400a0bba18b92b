// Exports a whole isosurface: merges the agents' blocks by block id, welds them, and takes them to
// world space. No gRPC types.

#ifndef ISOSCOPE_SERVER_EXPORT_SURFACE_EXPORT_H_
#define ISOSCOPE_SERVER_EXPORT_SURFACE_EXPORT_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/mesh/block_mesh.h"
#include "core/solid/surface_sums.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::server {

// The surface of one agent's blocks, block by block.
class SurfaceSource {
 public:
  virtual ~SurfaceSource() = default;
  // Replaces `block` by the next one. Block ids ascend. False at the end.
  virtual absl::StatusOr<bool> Next(mesh::BlockMesh* block) = 0;
  // The sums over its part of the surface, once Next has returned false; not set if it has none.
  [[nodiscard]] virtual const std::optional<solid::SurfaceSums>& sums() const = 0;
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

// The grid of an export.
struct ExportedVolume {
  volume::GridGeometry geometry;
  volume::BlockLayout layout;
  // Whether positions are from the origin of mesh::WorldPlacement.
  bool has_origin = false;
};

struct ExportedSurface {
  std::int64_t vertex_count = 0;
  // Not set if a source has none.
  std::optional<solid::SurfaceSums> sums;
};

// Pulls all sources to their ends, and gives the welded mesh to `emit` in chunks of at most
// kSurfaceChunkBytes. The chunks do not depend on how blocks are spread over sources. Stops at the
// first error of a source or of `emit`. INTERNAL if block ids do not ascend.
//
// first_vertex: of this surface; vertices of earlier surfaces come before it
//
absl::StatusOr<ExportedSurface> ExportSurface(const ExportedVolume& volume,
                                              const std::vector<SurfaceSource*>& sources,
                                              std::int64_t first_vertex,
                                              absl::FunctionRef<absl::Status(SurfaceChunk)> emit);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_EXPORT_SURFACE_EXPORT_H_
