// Extracts the surface of one block by marching cubes, of an isovalue or of labels.
// docs/numerics.md defines every number that it returns. The head of block_kernels.cc tells how
// each is computed. Steps 2 and 3 of a frame.

#ifndef ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_
#define ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_

#include <memory>

#include "absl/status/status.h"

#include "core/extract/block_shape.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/inside_rule.h"

namespace isoscope::extract {

// Holds scratch space that grows to the largest block and is reused. Thread-compatible: each thread
// has its own extractor.
class BlockExtractor {
 public:
  BlockExtractor(const volume::GridGeometry& geometry, const volume::BlockLayout& layout);
  // Shares `shapes`, which must be those of `layout`, with other extractors.
  BlockExtractor(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                 std::shared_ptr<const BlockShapes> shapes);
  ~BlockExtractor();
  BlockExtractor(BlockExtractor&&) noexcept;
  BlockExtractor& operator=(BlockExtractor&&) noexcept;

  // Returns the isosurface of a block: a view of scratch space, valid until the next call.
  //
  // samples:  the block's stored samples [z][y][x], x fastest, ghosts included
  // isovalue: field units
  //
  // A vertex lies at t = (isovalue - a) / (b - a) between the edge's lower sample a and its upper
  // sample b. Cells that touch a NaN sample have no triangles.
  // keeps_gradient_magnitudes: whether the values of the vertices are these
  //
  // REQUIRES: isovalue is finite. O(samples); at most 5 triangles a cell.
  mesh::BlockMeshView Extract(const volume::BlockSamples& samples, double isovalue,
                              bool keeps_gradient_magnitudes = false);
  // Does the same; the values of the vertices are those of another field, interpolated along the
  // grid edge with the t that places the vertex (docs/numerics.md, "Values of another field").
  //
  // field: its stored samples of the same block, of any type
  mesh::BlockMeshView ExtractWithField(const volume::BlockSamples& samples, double isovalue,
                                       const volume::BlockSamples& field);
  // Does the same as the first, and replaces `mesh` by a copy with edge keys.
  void ExtractWithEdgeKeys(const volume::BlockSamples& samples, double isovalue,
                           mesh::BlockMesh* mesh);

  // Do the same for a rule, which may be labels: then a vertex is the middle of its edge (t = 1/2),
  // normals are those of the Sobel filter, and a cell has at most 6 triangles (docs/numerics.md,
  // "Labels"). A smooth rule moves it, to t from 1/4 to 3/4 ("Smooth labels").
  //
  // REQUIRES: the rule has no labels, or keeps_gradient_magnitudes is false.
  mesh::BlockMeshView Extract(const volume::BlockSamples& samples, const volume::InsideRule& rule,
                              bool keeps_gradient_magnitudes = false);
  mesh::BlockMeshView ExtractWithField(const volume::BlockSamples& samples,
                                       const volume::InsideRule& rule,
                                       const volume::BlockSamples& field);
  void ExtractWithEdgeKeys(const volume::BlockSamples& samples, const volume::InsideRule& rule,
                           mesh::BlockMesh* mesh);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_EXTRACTOR_H_
