// Extracts the surface of labels of one block: where "is one of the labels" changes.
// docs/numerics.md, "Labels", defines it.

#ifndef ISOSCOPE_CORE_EXTRACT_LABEL_SURFACE_H_
#define ISOSCOPE_CORE_EXTRACT_LABEL_SURFACE_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/extract/block_kernels.h"
#include "core/extract/block_shape.h"
#include "core/extract/label_kernels.h"
#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/volume/block_samples.h"

namespace isoscope::extract {

// A block to extract. Does not own what its pointers refer to.
struct LabelTask {
  const volume::BlockSamples* samples = nullptr;
  const LabelSet* labels = nullptr;  // of the type of the samples
  const BlockShape* shape = nullptr;
  math::IndexBox stored;  // the block's samples with ghosts, in the volume
  math::IndexBox own;     // without
  const math::Mat3d* to_world = nullptr;
  const volume::BlockSamples* field = nullptr;  // of the vertices' values, or none
  bool smooths = false;                         // volume::InsideRule::smooths
};

// Scratch space that only grows.
struct LabelScratch {
  std::vector<std::uint8_t> marks;    // by stored sample: 1 if it is a label
  std::vector<std::uint8_t> numbers;  // by stored sample: 0 if it is NaN
  std::vector<float> values;          // marks with NaN, if there is any
  // The same with a layer of neighbours on all sides, where the volume's border has none.
  std::vector<std::uint8_t> padded_marks;
  std::vector<std::uint8_t> padded_numbers;
  std::vector<std::uint32_t> sobel;  // by padded sample
  std::vector<std::uint32_t> sobel_of_numbers;
  std::vector<std::uint32_t> padded_edge_samples;
  std::vector<double> fractions;  // of smooth surfaces, by vertex of an axis
  std::vector<double> ones;
  SobelScratch lines;
};

// Extracts the block into `block`. O(samples x intervals of labels); at most 6 triangles a cell.
void ExtractLabelBlock(const LabelTask& task, BlockScratch* block, LabelScratch* scratch);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_LABEL_SURFACE_H_
