// Turns the triangles of one block into fragments.
//
// Isosurface triangles are about a pixel in size, so set-up counts. Vertices are transformed once,
// most triangles are dropped because their box holds no pixel centre, and the others are filled
// many at a time (raster_kernels.h). Coordinates have 8 sub-pixel bits. The top-left rule holds:
// two triangles that share an edge never both cover a pixel and never both miss it. The fragments
// of a triangle do not depend on other triangles, blocks or threads.

#ifndef ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_
#define ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"

#include "core/image/pixel_mask.h"
#include "core/mesh/compact_mesh.h"
#include "core/render/raster_kernels.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"

namespace isoscope::render {

// Fragments of one block, in no particular order. A pixel may occur several times. Fragment i lies
// at (pixels[i] & 0xffff, pixels[i] >> 16).
struct FragmentBatch {
  view::PixelRect bounds;  // around all of them
  std::span<const std::uint32_t> pixels;
  std::span<const std::uint32_t> depths;  // IEEE bits of the window depth, in [0, 1]
  std::span<const std::uint32_t> triangles;
};

// The weights that tell whether a half-space keeps a fragment. A pixel may lie beside its triangle
// by a part of a pixel, because vertices are snapped.
enum class ClipWeights {
  kAtPixel,  // BarycentricsAtPixel: for a sliver, those of a point far off along it
  // BarycentricsNearPixel: for frames with caps, so that no gap opens along a cap.
  kNearPixel,
};

// Returns the half-spaces that fragments of a block must be tested with: none if it lies inside of
// the clip region as a whole, no value if it lies outside.
std::optional<std::span<const view::HalfSpace>> CutsOf(const view::Clipper& clipper,
                                                       const volume::BlockLayout& layout,
                                                       volume::BlockId block_id);

// Scratch space of one thread, reused from block to block. Thread-compatible.
class CpuRasterizer {
 public:
  // Calls `visit` with the fragments of the mesh, at most FragmentBuffer::kCapacity at a time.
  // Drops fragments outside the rectangle of `footprint`, the footprint of the mesh's block,
  // outside `open` if it is not null, and outside `cut_by`, the half-spaces in index space. Clamps
  // depths to [nearest_depth, 1]. The batch lives until visit returns.
  //
  // clip_weights: for `cut_by`
  void Rasterize(const mesh::CompactMesh& mesh, const view::View& view,
                 const view::Footprint& footprint, const image::PixelMask* open,
                 std::span<const view::HalfSpace> cut_by,
                 absl::FunctionRef<void(const FragmentBatch&)> visit,
                 ClipWeights clip_weights = ClipWeights::kAtPixel);

 private:
  // A triangle cut by five planes has at most 8 corners.
  using ClipPolygon = std::array<ClipVertex, 8>;

  // Drops the part of a convex polygon where the plane's distance is negative. Returns the number
  // of corners left.
  static std::size_t CutPolygon(const ClipVertex& plane, ClipPolygon* polygon, std::size_t count);
  void FillClipped(const mesh::CompactMesh& mesh);
  void ClipAndFill(const mesh::CompactMesh& mesh, std::uint32_t triangle);
  void Fill(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
            std::uint32_t triangle);
  void FillFromVertices(const mesh::CompactMesh& mesh, std::uint32_t triangle);
  void Flush();
  void MeasureDistances();
  [[nodiscard]] bool IsClipped(std::uint32_t triangle, std::uint32_t pixel) const;

  // These belong to the mesh in work.
  const mesh::CompactMesh* mesh_ = nullptr;
  const view::View* view_ = nullptr;
  std::span<const view::HalfSpace> cut_by_;
  ClipWeights clip_weights_ = ClipWeights::kAtPixel;
  Projection projection_;
  view::PixelRect rect_;
  float nearest_depth_ = 0;
  const image::PixelMask* open_ = nullptr;
  const absl::FunctionRef<void(const FragmentBatch&)>* visit_ = nullptr;

  ScreenVertices vertices_;
  std::vector<std::optional<ScreenVertex>> clipped_vertices_;  // none: in need of clipping
  std::vector<std::uint32_t> larger_;
  std::vector<double> distances_;  // [half-space * vertices + vertex], if the mesh is cut
  FragmentBuffer fragments_;
};

// Returns the perspective-correct weights of a triangle's vertices at the centre of a pixel of the
// picture. They lie in [0, 1] and sum to 1. A pure function of triangle, view and pixel.
std::array<double, 3> BarycentricsAtPixel(const mesh::CompactMesh& mesh, std::uint32_t triangle,
                                          const view::View& view, int x, int y);

// The same, but where the pixel lies beside the triangle: the weights of the point that is nearest
// to it on the screen.
std::array<double, 3> BarycentricsNearPixel(const mesh::CompactMesh& mesh, std::uint32_t triangle,
                                            const view::View& view, int x, int y);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_CPU_RASTERIZER_H_
