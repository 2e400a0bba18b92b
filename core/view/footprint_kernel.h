// Computes the footprints of many blocks, one block to a vector lane. Internal to core/view. All
// instruction sets give the same bits.

#ifndef ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_
#define ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/math/matrix.h"
#include "core/view/camera.h"

namespace isoscope::view {

// Bounds of the error of a float32 renderer in a vertex (docs/numerics.md, "How far float32 can
// move a vertex"). u = 2^-24 is half a unit in the last place of 1.
inline constexpr double kFloatRounding = 0x1p-24;
// A clip coordinate is wrong by at most this times sum |m_k p_k|: 5 u for the rounded matrix and
// for four products and three sums in any order, 3 u for a vertex made by clipping an edge;
// doubled.
inline constexpr double kClipError = 16 * kFloatRounding;
// Perspective division and viewport transform, relative to |ndc| + 1: 2.5 u for the division (as
// GPUs are allowed), 3 u for the transform, rounded up.
inline constexpr double kViewportError = 8 * kFloatRounding;
// Renderers snap vertices to a sub-pixel grid of at least 4 bits (OpenGL's minimum).
inline constexpr double kSnapErrorPx = 1.0 / 16;
// A block whose rectangle would need a wider margin gets the whole picture.
inline constexpr double kMaxMarginPx = 4;

// The bounds hold while float32 neither overflows nor loses digits near 0. So a block also gets the
// whole picture in two cases. A clip coordinate's bound of the error is above the first constant,
// 2^-20 of 2^120. Or a corner's w may be below the second, whose own error by underflow is 2^-47 of
// it.
inline constexpr double kMaxClipError = 0x1p100;
inline constexpr double kMinClipW = 0x1p-100;

// Boxes of cells, and their footprints.
struct FootprintBatch {
  static constexpr std::size_t kCapacity = 64;

  enum Outcome : std::uint8_t {
    kOnScreen,      // the fields below are set
    kOutside,       // outside the frustum
    kWholePicture,  // near the eye, or beyond float32: any pixel, any depth
  };

  // Boxes are taken in groups of this many. The caller fills the last group up with any box.
  static constexpr std::size_t kMultiple = 8;

  std::size_t count = 0;
  // In: the boxes, in index space, [axis][box].
  alignas(64) std::array<std::array<double, kCapacity>, 3> min;
  alignas(64) std::array<std::array<double, kCapacity>, 3> max;

  // Out: for kOnScreen the rectangle of View::FootprintOf, which may be empty, and its nearest
  // depth before that is rounded.
  std::array<Outcome, kCapacity> outcome;
  alignas(64) std::array<double, kCapacity> begin_x;
  alignas(64) std::array<double, kCapacity> begin_y;
  alignas(64) std::array<double, kCapacity> end_x;
  alignas(64) std::array<double, kCapacity> end_y;
  alignas(64) std::array<double, kCapacity> depth;
};

// Computes the footprints of `batch`: the same operations in the same order, and so the same bits,
// on every processor. Thread-safe.
void ComputeFootprints(const math::Mat4d& clip_from_index, const Viewport& viewport,
                       const Region& region, FootprintBatch* batch);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_
