// The inner loops of the CPU rasteriser, compiled for several instruction sets with Highway. The
// best one of the machine is chosen at run time. All of them give the same bits: they use no fused
// multiply-add and no approximate reciprocal, and nothing depends on the width of a vector.

#ifndef ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_
#define ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"

#include "core/mesh/compact_mesh.h"
#include "core/render/screen_vertices.h"
#include "core/view/view.h"

namespace isoscope::render {

// Triangles no larger than this are filled with 32-bit edge functions: (2^6 px * 2^8)^2 * 2 < 2^31.
inline constexpr std::int32_t kSmallTrianglePx = 60;

// The first pixel whose centre is at or right of `x` (1/256 pixels).
constexpr std::int32_t FirstPixelFrom(std::int32_t x) {
  return (x + kSubpixels / 2 - 1) >> kSubpixelBits;
}

// A triangle with a positive area, and the pixels that lie in both its box and the footprint.
struct ScreenTriangle {
  std::array<ScreenVertex, 3> v;
  std::uint32_t index = 0;
  view::PixelRect box;
};

// Fragments on their way into the picture.
class FragmentBuffer {
 public:
  static constexpr std::size_t kCapacity = 4096;

  FragmentBuffer()
      : pixels(kCapacity + kLaneSlack),
        depths(kCapacity + kLaneSlack),
        triangles(kCapacity + kLaneSlack) {}
  void Reset() {
    count = 0;
    bounds = {};
  }
  // Widens `bounds`. REQUIRES: `rect` is not empty.
  void Extend(const view::PixelRect& rect);
  // Drops the fragments for which keeps(pixel, triangle) is false.
  template <typename Keeps>
  void Retain(const Keeps& keeps) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t pixel = pixels[i];
      const std::uint32_t triangle = triangles[i];
      pixels[kept] = pixel;
      depths[kept] = depths[i];
      triangles[kept] = triangle;
      kept += keeps(pixel, triangle) ? 1U : 0U;
    }
    count = kept;
  }

  std::size_t count = 0;
  view::PixelRect bounds;             // around all fragments
  std::vector<std::uint32_t> pixels;  // x | y << 16
  std::vector<std::uint32_t> depths;  // IEEE bits, in [0, 1]
  std::vector<std::uint32_t> triangles;
};

// The triangles of one block of at most kMaxTinyExtentPx pixels a side.
struct TinyTriangleTask {
  mesh::TriangleVertices triangles;
  ScreenVertices* vertices = nullptr;
  std::int32_t origin_x = 0;  // a pixel left of and above all vertices
  std::int32_t origin_y = 0;
  view::PixelRect rect;  // not empty, within 255 px of the origin; drops fragments outside
  float nearest_depth = 0;
};
constexpr std::int32_t kMaxTinyExtentPx = 254;

// Appends the fragments of the triangles that are a few pixels in size to `buffer`, and the indices
// of larger triangles to `larger`. Calls `flush` when the buffer is full; `flush` must reset the
// buffer.
void FillTinyTriangles(const TinyTriangleTask& task, FragmentBuffer* buffer,
                       std::vector<std::uint32_t>* larger, absl::FunctionRef<void()> flush);

// The instruction set that the kernels use on this machine: "AVX-512", "AVX2", "SSE4", ...
const char* RasterInstructionSet();

// Appends the fragments of one triangle of any size.
void FillTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                  absl::FunctionRef<void()> flush);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_
