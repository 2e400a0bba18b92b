// The passes of extraction over one block, compiled for several instruction sets with Highway. The
// best one of the machine is chosen at run time. All give the same bits: no operation is fused or
// approximate, and none depends on the width of registers.

#ifndef ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_H_
#define ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/extract/block_shape.h"
#include "core/extract/case_table.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/volume/block_samples.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {

// A block to extract. Does not own what its pointers refer to.
struct BlockTask {
  volume::ScalarType type = volume::ScalarType::kUint8;
  const char* bytes = nullptr;  // shape->sample_count samples, any alignment
  double isovalue = 0;          // finite
  const BlockShape* shape = nullptr;
  math::Vec3d begin;                      // index of the first stored sample in the volume
  const math::Mat3d* to_world = nullptr;  // takes gradients from index to world space
  const CaseTable* case_table = nullptr;
  // The source of the vertices' values: one of the two, or none.
  bool keeps_gradient_magnitudes = false;
  const volume::BlockSamples* field = nullptr;  // another field's samples, of the same shape

  [[nodiscard]] bool keeps_values() const { return keeps_gradient_magnitudes || field != nullptr; }
};

// The result of extraction, and scratch space that only grows. Vectors are longer than their
// content, because kernels write whole registers: the counts say how much is valid.
struct BlockScratch {
  // The result.
  std::size_t vertex_count = 0;
  std::size_t index_count = 0;
  std::int64_t owned_vertex_count = 0;
  std::vector<math::Vec3f> positions;
  std::vector<math::Vec3f> normals;
  std::vector<float> values;        // gradient magnitudes, or those of the task's field
  std::vector<double> wide_values;  // in place of `values`, if HasWideValues
  std::vector<std::uint32_t> indices;
  // By axis: the lower samples, ascending, of the crossed edges that have a vertex. Vertex ids
  // count through these lists in order: x, y, z. edge_counts[axis] elements are valid.
  std::array<std::vector<std::uint32_t>, 3> edge_samples;
  std::array<std::size_t, 3> edge_counts{};

  // Bit rows, one bit a sample. An edge has the bit of its lower sample, a cell that of its lowest.
  // The first three rows have `padding` words before bit 0 and as many at the end, because shifts
  // read past both ends; the masks of the shape remove such bits.
  std::size_t padding = 0;
  BitRow inside;
  BitRow valid;        // not NaN; filled only if the block has extreme samples
  BitRow valid_cells;  // no corner is NaN; likewise
  std::array<BitRow, 3> crossed;
  BitRow active_cells;
  std::vector<std::uint32_t> vertex_ids;  // [sample][4]: by axis; filled for crossed edges only
  std::vector<std::uint32_t> cells;       // lowest samples of the active cells, ascending
};

// Extracts the block into `scratch`. Complexity: O(samples); at most 5 triangles a cell.
void ExtractBlock(const BlockTask& task, BlockScratch* scratch);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_H_
