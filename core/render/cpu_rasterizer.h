// Rasterises the triangles of one block into a small buffer of (depth, triangle) keys.
//
// Isosurface triangles are about a pixel in size, so what counts is set-up: vertices are
// transformed once, most triangles are dropped because their bounding box holds no pixel centre,
// and the buffer of a block stays in the cache. Fixed point with 8 sub-pixel bits and the top-left
// rule: two triangles that share an edge never both cover a pixel and never both miss it. A minimum
// of 64-bit keys makes the result independent of drawing order. Nothing here depends on other
// blocks or threads.

#ifndef ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_
#define ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "absl/functional/function_ref.h"

#include "core/mesh/block_mesh.h"
#include "core/view/view.h"

namespace isoscope::render {

// One rectangle of keys: IEEE bits of the window depth << 32 | triangle. kNoKey where nothing is.
struct KeyTile {
  view::PixelRect rect;
  const std::uint64_t* keys = nullptr;  // row by row, rect.end_x - rect.begin_x a row

  static constexpr std::uint64_t kNoKey = std::numeric_limits<std::uint64_t>::max();
};

// Scratch space of one thread, reused from block to block. Thread-compatible.
class CpuRasterizer {
 public:
  // Tiles are at most this wide and high, so that one fits the second-level cache.
  static constexpr int kTilePx = 96;

  // Calls `visit` for every tile that the mesh may cover, after its triangles are in it.
  // `footprint` is that of the mesh's block: fragments outside its rectangle are dropped, depths
  // are clamped to [nearest_depth, 1]. The tile lives until visit returns.
  void Rasterize(const mesh::BlockMesh& mesh, const view::View& view,
                 const view::Footprint& footprint, absl::FunctionRef<void(const KeyTile&)> visit);

 private:
  struct ClipVertex {
    double x = 0, y = 0, z = 0, w = 0;
  };
  // A vertex on the screen: 1/256 pixels from the top left, window depth.
  struct ScreenVertex {
    std::int32_t x = 0;
    std::int32_t y = 0;
    float z = 0;
  };
  // A triangle whose bounding box has a pixel centre of the footprint in it, with positive area.
  struct ScreenTriangle {
    std::array<ScreenVertex, 3> v;
    std::uint32_t index = 0;
    std::int32_t begin_x = 0, begin_y = 0, end_x = 0, end_y = 0;  // pixels, cut at the footprint
  };

  void TransformVertices(const mesh::BlockMesh& mesh, const view::View& view);
  [[nodiscard]] bool Project(const ClipVertex& clip, ScreenVertex* screen) const;
  void ClipAndEmit(const mesh::BlockMesh& mesh, std::uint32_t triangle);
  void Emit(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
            std::uint32_t triangle);
  void FillTile(const view::PixelRect& rect);
  template <typename Int>
  void FillTriangle(const ScreenTriangle& triangle, const view::PixelRect& rect);

  int width_ = 0;
  int height_ = 0;
  view::Footprint footprint_;
  std::array<double, 16> clip_from_index_{};
  std::vector<ScreenVertex> vertices_;
  std::vector<char> needs_clipping_;  // by vertex: in front of the near plane or far off screen
  std::vector<ScreenTriangle> triangles_;
  view::PixelRect bounds_;  // around triangles_
  std::vector<std::uint64_t> keys_;
};

// Perspective-correct weights of a triangle's vertices at a pixel centre; they sum to 1 and lie in
// [0, 1]. A pure function of triangle, view and pixel.
std::array<double, 3> BarycentricsAtPixel(const mesh::BlockMesh& mesh, std::uint32_t triangle,
                                          const view::View& view, int x, int y);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_
