// The inner loops of the CPU rasteriser, compiled for several instruction sets (Highway); the best
// one of the machine is chosen at run time. All of them give the same bits: no fused
// multiply-add, no approximate reciprocals, and nothing depends on the width of a vector.

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
// Triangles no larger than this are filled with 32-bit edge functions: (2^6 px * 2^8)^2 * 2 < 2^31.
inline constexpr std::int32_t kSmallTrianglePx = 60;
// Depths behind the far plane are cut here: they all show as 1, and stay finite.
inline constexpr double kMaxVertexDepth = 4;

// The first pixel whose centre is at or right of `x` (1/256 pixels).
constexpr std::int32_t FirstPixelFrom(std::int32_t x) {
  return (x + kSubpixels / 2 - 1) >> kSubpixelBits;
}

// From index space to the screen.
struct Projection {
  std::array<double, 16> clip_from_index{};
  double width_px = 0;
  double height_px = 0;
};

// The vertices of a mesh on the screen: 1/256 pixels from the top left, window depth. The vectors
// only grow, and are a few elements longer than `count`.
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
// A triangle with a positive area, and the pixels that its box and the footprint share.
struct ScreenTriangle {
  std::array<ScreenVertex, 3> v;
  std::uint32_t index = 0;
  view::PixelRect box;
};

// Fragments on their way into the picture.
class FragmentBuffer {
 public:
  static constexpr std::size_t kCapacity = 4096;
  // How much one vector operation may write at most.
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

// Where the vertices of a block lie. Valid only if all of them are in front of the near plane and
// in the guard band.
struct ScreenBounds {
  bool is_valid = false;
  std::int32_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;
};

// Fills x, y and z. A vertex's place is a function of its position and the projection alone, so
// blocks agree on the vertices they share. REQUIRES: positions is not empty.
ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices);

// The triangles of one block that extends over less than 255 pixels.
struct TinyTriangleTask {
  mesh::TriangleVertices triangles;
  ScreenVertices* vertices = nullptr;
  std::int32_t origin_x = 0;  // a pixel left of and above all vertices
  std::int32_t origin_y = 0;
  view::PixelRect rect;  // not empty; fragments outside are dropped; within 255 px of the origin
  float nearest_depth = 0;
};
constexpr std::int32_t kMaxTinyExtentPx = 254;

// Appends the fragments of all triangles that are a few pixels in size to `buffer`, and the numbers
// of those that are larger to `larger`. `flush` is called when the buffer is full: it must reset
// it.
void FillTinyTriangles(const TinyTriangleTask& task, FragmentBuffer* buffer,
                       std::vector<std::uint32_t>* larger, absl::FunctionRef<void()> flush);

// The instruction set that the kernels use on this machine: "AVX-512", "AVX2", "SSE4", ...
const char* RasterInstructionSet();

// Appends the fragments of one triangle of any size.
void FillTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                  absl::FunctionRef<void()> flush);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_RASTER_KERNELS_H_
