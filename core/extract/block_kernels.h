// The passes of extraction over one block, compiled for several instruction sets (Highway); the
// best one that the machine has is chosen at run time. All give the same bits: no operation is
// fused, none is approximate, and none depends on the width of registers.

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
#include "core/volume/scalar_type.h"

namespace isoscope::extract {

// One block to extract. Does not own what it points to.
struct BlockTask {
  volume::ScalarType type = volume::ScalarType::kUint8;
  const char* bytes = nullptr;  // shape->sample_count samples, any alignment
  double isovalue = 0;          // finite
  const BlockShape* shape = nullptr;
  math::Vec3d begin;  // the first stored sample, in the volume's samples
  // World gradient from index gradient.
  const math::Mat3d* to_world = nullptr;
  const CaseTable* case_table = nullptr;
};

// What extraction leaves, and scratch space that only grows. Vectors are longer than what they
// hold: kernels write whole registers.
struct BlockScratch {
  // The result.
  std::size_t vertex_count = 0;
  std::size_t index_count = 0;
  std::int64_t owned_vertex_count = 0;
  std::vector<math::Vec3f> positions;
  std::vector<math::Vec3f> normals;
  std::vector<std::uint32_t> indices;
  // By axis, the lower samples of the crossed edges that have a vertex; vertices are numbered in
  // this order. edge_counts[axis] are in use.
  std::array<std::vector<std::uint32_t>, 3> edge_samples;
  std::array<std::size_t, 3> edge_counts{};

  // One bit a sample; the first three have bit 0 at word `padding` and as many words at the end,
  // because shifts read past both ends. What they read there is masked.
  std::size_t padding = 0;
  BitRow inside;
  BitRow valid;        // not NaN
  BitRow valid_cells;  // no corner is NaN
  std::array<BitRow, 3> crossed;
  BitRow active_cells;
  std::vector<std::uint32_t> vertex_ids;  // [sample][axis of 4], only crossed edges are filled
  std::vector<std::uint32_t> cells;       // lowest samples of active cells
};

// Extracts the block into `scratch`. Complexity: O(samples); at most 5 triangles a cell.
void ExtractBlock(const BlockTask& task, BlockScratch* scratch);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_H_
