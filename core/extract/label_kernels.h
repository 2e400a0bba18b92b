// The inner loops of label surfaces, compiled for several instruction sets with Highway. All give
// the same bits: they compare, add integers, or round each operation once.
//
// Blocks are lines of samples, as for block_kernels.h: sample (x, y, z) is element
// x + y * row + z * slice.

#ifndef ISOSCOPE_CORE_EXTRACT_LABEL_KERNELS_H_
#define ISOSCOPE_CORE_EXTRACT_LABEL_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {

// Labels as samples of one type. Made once for many blocks.
struct LabelSet {
  // All labels from `first` to `last`, both samples of the type.
  struct Interval {
    double first = 0;
    double last = 0;
  };

  volume::ScalarType type = volume::ScalarType::kUint8;
  // Ascending. Labels that are no sample of the type are left out; those of integer types that
  // follow each other are one interval.
  std::vector<Interval> intervals;
  // Empty, or by the bits of a sample: 1 iff it is a label. For many intervals of a small type.
  std::vector<std::uint8_t> table;
};

// Returns the set of such labels. labels: ascending, distinct, finite
LabelSet MakeLabelSet(volume::ScalarType type, std::span<const double> labels);

// Kernels write up to this many elements past the end.
inline constexpr std::size_t kMarkPadding = 64;

// Writes for each of `count` samples 1 if it is a label, else 0. NaN is not.
// marks: capacity of count + kMarkPadding
void MarkLabels(const LabelSet& labels, const char* bytes, std::size_t count, std::uint8_t* marks);

// Writes for each of `count` samples 1 if it is a number, 0 if it is NaN, and returns true if any
// is NaN. marks: capacity of count + kMarkPadding. Integer types: returns false, writes nothing.
bool MarkNumbers(volume::ScalarType type, const char* bytes, std::size_t count,
                 std::uint8_t* marks);

// The Sobel filter of a sample in three bytes of a word, from the lowest: x, y, z, each plus
// kSobelZero; the highest byte is 0. Sums of two have 2 * kSobelZero.
inline constexpr std::uint32_t kSobelZero = 16;

// Scratch space of FillSobel that only grows.
struct SobelScratch {
  std::array<std::vector<std::int8_t>, 5> lines;
};

// Writes the Sobel filter of marks, which are 0 or 1: the difference along one axis, with weights
// 1 2 1 along both others, -16 to 16. Right for samples that have neighbours on all sides; for
// others it is any value.
//
// marks:  `count` of them, then kMarkPadding more
// sobel:  capacity of count + kMarkPadding
void FillSobel(const std::uint8_t* marks, std::size_t row, std::size_t slice, std::size_t count,
               SobelScratch* scratch, std::uint32_t* sobel);

// Vertices on edges along one axis, in a block that has neighbours on all sides.
struct LabelVertices {
  std::size_t axis = 0;
  std::size_t count = 0;
  const std::uint32_t* lower_samples = nullptr;  // the lower end of each edge
  std::size_t upper_distance = 0;                // from it to the upper end, in samples
  const std::uint8_t* marks = nullptr;           // by sample: 1 if it is inside
  const std::uint32_t* sobel = nullptr;          // by sample
};

// Writes the normals: the sum of the filter at both ends of the edge, or where that is 0 the plain
// difference along the edge, to world space, negated, of unit length. (0, 0, 0) where the result is
// not finite.
//
// to_world: takes gradients from index to world space
// normals:  capacity of count + 64
void FillLabelNormals(const LabelVertices& vertices, const math::Mat3d& to_world,
                      math::Vec3f* normals);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_LABEL_KERNELS_H_
