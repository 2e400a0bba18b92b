// Deferred shading of pixels whose triangle is known, many at a time. It is compiled for several
// instruction sets, as raster_kernels.h is, and all of them give the same bits.

#ifndef ISOSCOPE_CORE_RENDER_SHADE_KERNEL_H_
#define ISOSCOPE_CORE_RENDER_SHADE_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/view/view.h"

namespace isoscope::render {

// Colour is a function of |n . v| alone. With this many steps, neighbours differ by one 255th.
inline constexpr std::size_t kShadeSteps = 4096;

// The rays through the pixels, from the near plane on.
struct ShadeRays {
  explicit ShadeRays(const view::View& view);

  view::LinearVec3f index_origin;
  view::LinearVec3f index_direction;
  view::LinearVec3f world_direction;
};

// Pixels to shade, each with its triangle.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): lanes begin at cache lines.
struct ShadeBatch {
  static constexpr std::size_t kCapacity = 512;
  static constexpr std::size_t kSize = kCapacity + 16;  // vector operations write whole vectors
  using Lane = std::array<float, kSize>;

  std::size_t count = 0;
  alignas(64) Lane x;  // pixel centres, in pixels of the whole viewport
  alignas(64) Lane y;
  // [3 * corner + axis]
  alignas(64) std::array<Lane, 9> position;  // index space
  // World space, as mesh::CompactNormal. (0, 0, 0) means that there is none.
  alignas(64) std::array<std::array<std::int32_t, kSize>, 9> normal;
  // The result: the step of |n . v|, 0 to kShadeSteps.
  alignas(64) std::array<std::uint32_t, kSize> step;
  // The result if `keeps_normals`: the mixed normal, [axis], of no particular length.
  bool keeps_normals = false;
  alignas(64) std::array<Lane, 3> mixed_normal;
  // Input if `keeps_map_levels`: levels of the colour map (MapLevelsToMix), [corner]: finite, or
  // NaN at all corners. The result is the mixed level; NaN of NaN.
  bool keeps_map_levels = false;
  alignas(64) std::array<Lane, 3> map_level;
  alignas(64) Lane mixed_map_level;
  // Pixels whose triangle is seen too much from the side for floats. Their step, mixed normal and
  // mixed level are not valid.
  std::size_t inexact_count = 0;
  alignas(64) std::array<std::uint32_t, kSize> inexact;
};

// Fills step, inexact_count and inexact for the first `count` pixels.
void ComputeShadeSteps(const ShadeRays& rays, ShadeBatch* batch);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_SHADE_KERNEL_H_
