// The footprints of many blocks at a time, a block a vector lane.

#ifndef ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_
#define ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/math/matrix.h"

namespace isoscope::view {

// Bounds of what a renderer in float32 may do to a vertex (docs/numerics.md, "Camera"). u is half
// a unit in the last place of 1.
inline constexpr double kFloatRounding = 0x1p-24;
// A clip coordinate is wrong by at most this times sum |m_k p_k|: 5 u for rounding the matrix and
// for four products and three sums in any order, 3 u for a vertex made by clipping an edge; twice.
inline constexpr double kClipError = 16 * kFloatRounding;
// Perspective division and viewport transform, relative to |ndc| + 1: 2.5 u for the division (as
// GPUs are allowed), 3 u for the transform, rounded up.
inline constexpr double kViewportError = 8 * kFloatRounding;
// Vertices are snapped to a sub-pixel grid of at least 4 bits (OpenGL's minimum).
inline constexpr double kSnapErrorPx = 1.0 / 16;
// A block whose rectangle would need a wider margin is given the whole viewport.
inline constexpr double kMaxMarginPx = 4;

// Some boxes of cells, and what becomes of them.
struct FootprintBatch {
  static constexpr std::size_t kCapacity = 64;

  enum Outcome : std::uint8_t {
    kOnScreen,   // the fields below are set
    kOutside,    // of the frustum
    kUndecided,  // near the eye: View::FootprintOf knows
  };

  // Boxes come in so many: fill up the last of them with whatever box.
  static constexpr std::size_t kMultiple = 8;

  std::size_t count = 0;
  // In index space, by axis.
  alignas(64) std::array<std::array<double, kCapacity>, 3> min;
  alignas(64) std::array<std::array<double, kCapacity>, 3> max;

  std::array<Outcome, kCapacity> outcome;
  // View::FootprintOf's rectangle, may be empty; and its nearest depth before it is rounded.
  alignas(64) std::array<double, kCapacity> begin_x;
  alignas(64) std::array<double, kCapacity> begin_y;
  alignas(64) std::array<double, kCapacity> end_x;
  alignas(64) std::array<double, kCapacity> end_y;
  alignas(64) std::array<double, kCapacity> depth;
};

// Computes what View::FootprintOf does, by the same operations in the same order: the same bits on
// every processor.
void ComputeFootprints(const math::Mat4d& clip_from_index, int width_px, int height_px,
                       FootprintBatch* batch);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_FOOTPRINT_KERNEL_H_
