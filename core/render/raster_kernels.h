// The inner loops of the CPU rasteriser, compiled for several instruction sets with Highway. The
// best one of the machine is chosen at run time. All of them give the same bits: they use no fused
// multiply-add and no approximate reciprocal, and nothing depends on the width of a vector.

#ifndef ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_
#define ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"

#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/view/view.h"

namespace isoscope::render {

inline constexpr int kSubpixelBits = 8;
inline constexpr std::int32_t kSubpixels = 1 << kSubpixelBits;
// Vertices further out than this are clipped first, so that products of coordinate differences fit
// 64 bits with room: (2 * 2^15 px * 2^8)^2 = 2^48.
inline constexpr double kGuardBandPx = 32768;
// The same for viewports above view::kMaxViewportPx: (2 * 2^17 px * 2^8)^2 = 2^52.
inline constexpr double kWideGuardBandPx = 131072;
// Triangles no larger than this are filled with 32-bit edge functions: (2^6 px * 2^8)^2 * 2 < 2^31.
inline constexpr std::int32_t kSmallTrianglePx = 60;
// The largest depth of a vertex. Depths behind the far plane all show as 1, but must stay finite.
inline constexpr double kMaxVertexDepth = 4;

// The first pixel whose centre is at or right of `x` (1/256 pixels).
constexpr std::int32_t FirstPixelFrom(std::int32_t x) {
  return (x + kSubpixels / 2 - 1) >> kSubpixelBits;
}

// Takes index space to the screen.
struct Projection {
  std::array<double, 16> clip_from_index{};
  double width_px = 0;  // of the whole viewport
  double height_px = 0;
  // Screen coordinates count from this pixel of the whole viewport, which is the first of the
  // picture.
  std::int32_t origin_x = 0;
  std::int32_t origin_y = 0;
  double guard_band_px = kGuardBandPx;  // on both sides of the whole's first pixel
};

// The vertices of a mesh on the screen: x and y in 1/256 pixel from the picture's top left, window
// depth z.
// The vectors only grow, and are at least FragmentBuffer::kSlack elements longer than `count`.
struct ScreenVertices {
  std::size_t count = 0;
  std::vector<std::int32_t> x;
  std::vector<std::int32_t> y;
  std::vector<float> z;
  std::vector<std::uint32_t> packed;  // scratch of FillTinyTriangles

  void Resize(std::size_t vertex_count);
};

struct ScreenVertex {
  std::int32_t x = 0;
  std::int32_t y = 0;
  float z = 0;
};
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
  // The most elements that one vector operation writes.
  static constexpr std::size_t kSlack = 16;

  FragmentBuffer()
      : pixels(kCapacity + kSlack), depths(kCapacity + kSlack), triangles(kCapacity + kSlack) {}
  void Reset() {
    count = 0;
    bounds = {};
  }
  // Widens `bounds`. REQUIRES: `rect` is not empty.
  void Extend(const view::PixelRect& rect);

  std::size_t count = 0;
  view::PixelRect bounds;             // around all fragments
  std::vector<std::uint32_t> pixels;  // x | y << 16
  std::vector<std::uint32_t> depths;  // IEEE bits, in [0, 1]
  std::vector<std::uint32_t> triangles;
};

// The bounds of a block's vertices, in 1/256 pixel. Valid only if every vertex lies behind the near
// plane, as seen from the eye, and in the guard band.
struct ScreenBounds {
  bool is_valid = false;
  std::int32_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;
};

// Fills x, y and z. The result for a vertex depends on its position and the projection alone, so
// blocks agree on the vertices that they share. REQUIRES: positions is not empty.
ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices);

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
