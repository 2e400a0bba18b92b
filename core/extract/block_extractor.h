// Extracts the isosurface of one block (marching cubes; docs/numerics.md).

#ifndef ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_
#define ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_

#include <memory>

#include "absl/status/status.h"

#include "core/extract/block_shape.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::extract {

// Holds scratch space that grows to the largest block and is reused. Thread-compatible: one for
// each thread.
class BlockExtractor {
 public:
  BlockExtractor(const volume::GridGeometry& geometry, const volume::BlockLayout& layout);
  // With `shapes` of that layout, which many extractors may share.
  BlockExtractor(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                 std::shared_ptr<const BlockShapes> shapes);
  ~BlockExtractor();
  BlockExtractor(BlockExtractor&&) noexcept;
  BlockExtractor& operator=(BlockExtractor&&) noexcept;

  // The isosurface of the block, in scratch space: until the next call. `samples` as BlockSamples
  // says; isovalue in field units. Cells that touch a NaN sample have no triangles. A vertex lies
  // at t = (isovalue - a) / (b - a) between the edge's lower sample a and upper sample b.
  // REQUIRES: isovalue is finite. Complexity: O(samples); at most 5 triangles a cell.
  mesh::BlockMeshView Extract(const volume::BlockSamples& samples, double isovalue);
  // Replaces `mesh` by it, with edge keys.
  void ExtractWithEdgeKeys(const volume::BlockSamples& samples, double isovalue,
                           mesh::BlockMesh* mesh);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_
